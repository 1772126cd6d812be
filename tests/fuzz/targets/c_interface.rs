//! Any calls of the C interface in any order, with handles that are alive, freed or invented, with lengths that do not fit,
//! null and misaligned pointers, odd rows and damaged models: every call ends in a status, and what lives goes on.

#![no_main]
#![allow(unsafe_code)]

use std::ptr::{null, null_mut};

use granular_id_c::extract::*;
use granular_id_c::gid_status::*;
use granular_id_c::model::*;
use granular_id_c::stream::*;
use granular_id_c::{gid_last_error, gid_status};
use libfuzzer_sys::fuzz_target;

const MODELS: [&[u8]; 2] = [
    include_bytes!("../../data/model/model.safetensors"),
    include_bytes!("../../data/rules/model.safetensors"),
];

/// The most values of a call.
const ROOM: usize = 128;

/// The fuzzer's bytes, then zeros.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn next(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    /// Mostly small ones; now and then a number that no computer holds.
    fn size(&mut self, usual: usize) -> usize {
        match self.next() {
            255 => usize::MAX,
            254 => usize::MAX / 16 + 1,
            byte if byte < 128 => usual,
            byte => usize::from(byte) % ROOM,
        }
    }

    fn value(&mut self) -> f64 {
        match self.next() {
            255 => f64::NAN,
            254 => f64::NEG_INFINITY,
            253 => 1e300,
            252 => 5e-324,
            byte => f64::from(byte) / 64.0 - 2.0,
        }
    }

    /// One of those made so far, or an invented one.
    fn handle(&mut self, made: &[u64]) -> u64 {
        let byte = usize::from(self.next());
        made.get(byte % (made.len() + 1)).copied().unwrap_or(byte as u64 * 0x0101_0101)
    }

    /// A pointer, or null, or a misaligned one.
    fn pointer<T>(&mut self, room: *mut T) -> *mut T {
        match self.next() {
            0..16 => null_mut(),
            16..32 => room.cast::<u8>().wrapping_add(1).cast(),
            _ => room,
        }
    }
}

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes(data);
    let (mut models, mut streams) = (Vec::new(), Vec::new());
    let (mut room, mut out) = ([0.0; ROOM], [0.0; ROOM]);
    while !bytes.0.is_empty() {
        let call = bytes.next();
        let (model, stream) =
            (gid_model { id: bytes.handle(&models) }, gid_stream { id: bytes.handle(&streams) });
        // SAFETY: pointers are null, misaligned, or lead to as much room as the length says; lengths beyond that are such
        // that no array has them.
        let status = unsafe {
            match call % 16 {
                0 => {
                    let mut file = MODELS[usize::from(call >> 4) % 2].to_vec();
                    if call > 127 {
                        let place = usize::from(bytes.next()) * 31 % file.len();
                        file[place] ^= bytes.next();
                    }
                    let mut made = gid_model { id: 0 };
                    let status = gid_model_load_bytes(file.as_ptr(), file.len(), &raw mut made);
                    models.extend((status == GID_OK).then_some(made.id));
                    status
                }
                1 | 2 => {
                    let mut made = gid_stream { id: 0 };
                    let status = gid_stream_new(model, &raw mut made);
                    streams.extend((status == GID_OK).then_some(made.id));
                    status
                }
                3 => gid_stream_free(stream),
                4 if call > 127 => gid_model_free(model),
                4 => gid_model_load(null(), null_mut()),
                5 => gid_stream_reset(stream),
                6 => {
                    let mut info = gid_model_info {
                        n_classes: 0,
                        n_axes: 0,
                        n_samples: 0,
                        rate_hz: 0.0,
                        lead_s: 0.0,
                        synthetic: false,
                    };
                    let status = gid_model_get_info(model, bytes.pointer(&raw mut info));
                    let k = bytes.size(1);
                    assert!(status != GID_HANDLE || gid_model_label(model, k).is_null());
                    let axis = gid_model_axis(model, k);
                    assert!(axis.is_null() || *axis != 0);
                    assert_eq!(gid_model_unit(model, k).is_null(), axis.is_null());
                    status
                }
                7 => {
                    let n = bytes.size(5);
                    gid_stream_losses(stream, bytes.pointer(out.as_mut_ptr()), n)
                }
                8 | 9 => {
                    let mut spec = gid_spec_default();
                    (spec.n_axes, spec.order) = (bytes.size(6), bytes.size(8));
                    (spec.n_bins, spec.n_bin_ranges) = (bytes.size(5), bytes.size(1).min(ROOM / 2));
                    room[..4].fill_with(|| bytes.value());
                    spec.bin_ranges = room.as_ptr();
                    (spec.raw, spec.clip, spec.steady) = (bytes.next(), bytes.next(), bytes.next());
                    let (n, n_out) = (bytes.size(12), bytes.size(42));
                    let mut n_features = 0;
                    let status = gid_n_features(&raw const spec, n, &raw mut n_features);
                    let (rows, features) =
                        (bytes.pointer(room.as_mut_ptr()), bytes.pointer(out.as_mut_ptr()));
                    let extracted = gid_extract(&raw const spec, rows, n, features, n_out);
                    assert!(extracted != GID_OK || (status, n_features) == (GID_OK, n_out));
                    extracted
                }
                10 => {
                    let mut decision = std::mem::MaybeUninit::<gid_decision>::zeroed();
                    let status = gid_stream_decide(stream, bytes.pointer(decision.as_mut_ptr()));
                    let decision = decision.assume_init();
                    assert!(status != GID_OK || decision.label < 6 && decision.margin >= 0.0);
                    status
                }
                _ => {
                    let n = bytes.size(6);
                    room[..n.min(12)].fill_with(|| bytes.value());
                    gid_stream_push(stream, bytes.pointer(room.as_mut_ptr()), n)
                }
            }
        };
        assert_ne!(status, GID_PANIC);
        let mut text = [1; 64];
        // SAFETY: so much room.
        let length = unsafe { gid_last_error(text.as_mut_ptr(), text.len()) };
        assert!(text.contains(&0) && length <= 1024 && (length > 0 || is_good(status)));
    }
    for id in streams {
        gid_stream_free(gid_stream { id });
    }
    for id in models {
        gid_model_free(gid_model { id });
    }
});

fn is_good(status: gid_status) -> bool {
    matches!(status, GID_OK | GID_FULL)
}
