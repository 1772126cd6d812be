//! Streams: rows in, decisions out, callable from a real-time loop.
//!
//! The table of streams has no lock. Each place says whether it is empty, idle or busy, and which of the streams it has held is
//! there now; a call makes an idle place busy, or ends. It never waits.

use std::cell::UnsafeCell;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicU64, Ordering};

use granular_id::stream::StreamingIdentifier;

use crate::gid_status::{GID_BUSY, GID_FULL, GID_HANDLE, GID_MEMORY, GID_OK, GID_SIZE};
use crate::last_error::failed;
use crate::model::{gid_model, loaded};
use crate::{
    check_pointer, gid_status, guarded, refused, slice, slice_mut, write, GID_CANDIDATE_BYTES,
    GID_MAX_STREAMS,
};

/// A stream of rows through a model. Number 0 is never one.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gid_stream {
    /// Its number.
    pub id: u64,
}

/// What a model says of the rows so far.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct gid_decision {
    /// Index, as of `gid_model_label`, of the class with the smallest mean loss; the first of equal ones.
    pub label: usize,
    /// Its mean loss: the value by which classes are ranked.
    pub loss: f64,
    /// By how much the second mean loss is larger.
    pub margin: f64,
    /// Probability of the label; NaN before the window is complete, and of a model without probabilities.
    pub probability: f64,
    /// Rows of the window so far.
    pub n_seen: usize,
    /// The classes that it may be: of class k bit `k % 8` of byte `k / 8`. None before the window is complete, and of a model
    /// without such a rule.
    pub candidates: [u8; GID_CANDIDATE_BYTES],
    /// 1 if it is like no class: the label is then the nearest of the wrong ones. 0 if not, -1 before the window is complete,
    /// and of a model without such a rule.
    pub unknown: i8,
    /// Whether the window is complete.
    pub is_final: bool,
    /// Whether the margin meets the model's rule for early answers.
    pub is_sure: bool,
}

struct Live {
    stream: StreamingIdentifier,
    temperature: Option<f64>,
}

// The state of a place: the number of its stream times four, and one of these.
const EMPTY: u64 = 0;
const IDLE: u64 = 1;
const BUSY: u64 = 2;

struct Place {
    state: AtomicU64,
    live: UnsafeCell<Option<Box<Live>>>,
}

// SAFETY: `live` is touched only by whoever made `state` busy.
unsafe impl Sync for Place {}

static PLACES: [Place; GID_MAX_STREAMS] =
    [const { Place { state: AtomicU64::new(EMPTY), live: UnsafeCell::new(None) } }; GID_MAX_STREAMS];

/// A stream during a call.
struct Held {
    place: &'static Place,
    /// The state of the place afterwards.
    after: u64,
}

impl Held {
    /// The stream of a handle, unless another thread has it.
    #[allow(clippy::cast_possible_truncation)] // the core wants 64 bits
    fn new(stream: gid_stream) -> Result<Self, gid_status> {
        let (index, number) = (stream.id as usize % GID_MAX_STREAMS, stream.id / GID_MAX_STREAMS as u64);
        let (place, idle, busy) = (&PLACES[index], number << 2 | IDLE, number << 2 | BUSY);
        match place.state.compare_exchange(idle, busy, Ordering::Acquire, Ordering::Relaxed) {
            Ok(_) => Ok(Self { place, after: idle }),
            Err(found) if found == busy => {
                Err(failed(GID_BUSY, format_args!("another thread is in a call on stream {}", stream.id)))
            }
            Err(_) => Err(failed(GID_HANDLE, format_args!("stream {} was freed or never made", stream.id))),
        }
    }

    /// An empty place, and the handle of the stream that will be there.
    fn empty() -> Result<(Self, gid_stream), gid_status> {
        for (index, place) in PLACES.iter().enumerate() {
            let state = place.state.load(Ordering::Relaxed);
            let number = (state >> 2) + 1;
            let busy = number << 2 | BUSY;
            let is_taken = || place.state.compare_exchange(state, busy, Ordering::Acquire, Ordering::Relaxed);
            if state & 3 == EMPTY && is_taken().is_ok() {
                let id = number * GID_MAX_STREAMS as u64 + index as u64;
                return Ok((Self { place, after: number << 2 | IDLE }, gid_stream { id }));
            }
        }
        Err(failed(GID_MEMORY, format_args!("{GID_MAX_STREAMS} streams are there: free one")))
    }

    fn place(&mut self) -> &mut Option<Box<Live>> {
        // SAFETY: the place is busy because of this call, and `self` is borrowed.
        unsafe { &mut *self.place.live.get() }
    }
}

impl Deref for Held {
    type Target = Live;

    fn deref(&self) -> &Live {
        // SAFETY: as above; a place that was idle holds a stream.
        unsafe { &*self.place.live.get() }.as_ref().expect("a stream")
    }
}

impl DerefMut for Held {
    fn deref_mut(&mut self) -> &mut Live {
        self.place().as_mut().expect("a stream")
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        self.place.state.store(self.after, Ordering::Release);
    }
}

/// Makes a stream before its first row, and all the memory that it will need.
#[no_mangle]
pub unsafe extern "C" fn gid_stream_new(model: gid_model, stream: *mut gid_stream) -> gid_status {
    guarded(|| {
        check_pointer(stream, "stream")?;
        let loaded = loaded(model)?;
        let made = StreamingIdentifier::new(loaded.model.clone(), None).map_err(|error| refused(&error))?;
        let live = Box::new(Live { stream: made, temperature: loaded.temperature });
        let (mut held, handle) = Held::empty()?;
        *held.place() = Some(live);
        // SAFETY: as the header says.
        unsafe { write(stream, "stream", handle) }
    })
}

/// Frees a stream; not while another thread is in a call on it: that is `GID_BUSY`, and the stream stays.
#[no_mangle]
pub extern "C" fn gid_stream_free(stream: gid_stream) -> gid_status {
    guarded(|| {
        let mut held = Held::new(stream)?;
        held.after = held.after & !3 | EMPTY;
        let live = held.place().take();
        drop(held);
        drop(live);
        Ok(GID_OK)
    })
}

/// Takes rows, `n` values in all, each row a value per axis in the units of the model, until the window is complete. `GID_FULL`
/// if rows are left then: the last row of the window still gives `GID_OK`, so count rows to `n_samples`. Real-time: allocates
/// nothing, takes no lock, and the work is bounded for each row.
///
/// `n` must be a multiple of the model's `n_axes`: six values are two rows of a model of three axes. NaN, infinity and values too
/// large to compute with are refused, and with them all rows of the call; the sentence counts rows from the first of the call.
#[no_mangle]
pub unsafe extern "C" fn gid_stream_push(stream: gid_stream, rows: *const f64, n: usize) -> gid_status {
    guarded(|| {
        let mut held = Held::new(stream)?;
        // SAFETY: as the header says.
        let rows = unsafe { slice(rows, n, "rows") }?;
        let n_axes = held.stream.model().n_axes();
        if !n.is_multiple_of(n_axes) {
            let wanted =
                format_args!("rows must hold a multiple of {n_axes} values, one for each axis, got {n}");
            return Err(failed(GID_SIZE, wanted));
        }
        let n_taken = held.stream.push(rows).map_err(|error| refused(&error))?;
        let is_full = n_taken * n_axes < n;
        Ok(if is_full { GID_FULL } else { GID_OK })
    })
}

/// Decides from the rows so far, provisionally before the window is complete: before the first row the label says nothing about
/// the push. Real-time: allocates nothing and takes no lock; the work is that of a label, with multi-band features that of all
/// features.
#[no_mangle]
pub unsafe extern "C" fn gid_stream_decide(stream: gid_stream, decision: *mut gid_decision) -> gid_status {
    guarded(|| {
        let mut held = Held::new(stream)?;
        check_pointer(decision, "decision")?;
        let temperature = held.temperature;
        let at = held.stream.standing().map_err(|error| refused(&error))?;
        let mut candidates = [0; GID_CANDIDATE_BYTES];
        for class in at.candidates {
            candidates[class / 8] |= 1 << (class % 8);
        }
        let probability = match temperature {
            Some(temperature) if at.is_final => probability(at.losses, at.best, temperature),
            _ => f64::NAN,
        };
        let found = gid_decision {
            label: at.best,
            loss: at.losses[at.best],
            margin: at.margin,
            probability,
            n_seen: at.n_seen,
            candidates,
            unknown: at.unknown.map_or(-1, i8::from),
            is_final: at.is_final,
            is_sure: at.is_sure,
        };
        // SAFETY: as the header says.
        unsafe { write(decision, "decision", found) }
    })
}

/// A softmax of minus the losses: of the largest share.
fn probability(losses: &[f64], best: usize, temperature: f64) -> f64 {
    let scaled = |loss: f64| -loss / temperature;
    let largest = scaled(losses[best]);
    1.0 / losses.iter().map(|loss| libm::exp(scaled(*loss) - largest)).sum::<f64>()
}

/// The mean loss of each class into `losses`, which has room for `n` values, as many as there are classes. Real-time as
/// `gid_stream_decide`.
#[no_mangle]
pub unsafe extern "C" fn gid_stream_losses(stream: gid_stream, losses: *mut f64, n: usize) -> gid_status {
    guarded(|| {
        let mut held = Held::new(stream)?;
        // SAFETY: as the header says.
        let out = unsafe { slice_mut(losses, n, "losses") }?;
        let n_classes = held.stream.model().classes().len();
        if n != n_classes {
            let wanted = format_args!("losses must have room for {n_classes} values, got {n}");
            return Err(failed(GID_SIZE, wanted));
        }
        out.copy_from_slice(held.stream.losses().map_err(|error| refused(&error))?);
        Ok(GID_OK)
    })
}

/// Back to the state before the first row. Real-time as `gid_stream_push`.
#[no_mangle]
pub extern "C" fn gid_stream_reset(stream: gid_stream) -> gid_status {
    guarded(|| {
        Held::new(stream)?.stream.reset();
        Ok(GID_OK)
    })
}

/// What a call of another thread on a stream does while it lasts.
#[cfg(test)]
pub(crate) fn beside_a_call(stream: gid_stream) -> impl Drop {
    Held::new(stream).expect("an idle stream")
}
