//! The paper's features of a recording.

use granular_id::dsp::Outside;
use granular_id::features::Initial;
use granular_id::{BatchShape, Extractor, FeatureSpec};

use crate::gid_status::{GID_OK, GID_SIZE};
use crate::last_error::failed;
use crate::{check_pointer, gid_status, guarded, refused, slice, slice_mut, write};

/// What to compute from a recording. Make it by `gid_spec_default`, then change what differs; bytes are true unless 0.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct gid_spec {
    /// Values of a row.
    pub n_axes: usize,
    /// Rows in a second.
    pub rate_hz: f64,
    /// Cut-off of the Butterworth high-pass before the histogram.
    pub cutoff_hz: f64,
    /// Order of the high-pass, 1 to 32.
    pub order: usize,
    /// Bins of each histogram.
    pub n_bins: usize,
    /// Low and high end of the histograms in N and N m: one pair for all axes, or one for each.
    pub bin_ranges: *const f64,
    /// Pairs in `bin_ranges`.
    pub n_bin_ranges: usize,
    /// Count values outside the range in the first and last bin; else not at all.
    pub clip: u8,
    /// Densities that integrate to one instead of counts.
    pub density: u8,
    /// Begin the filter as if the first row had lasted for ever; else at rest.
    pub steady: u8,
    /// Include the samples.
    pub raw: u8,
    /// Include the histograms.
    pub hfmh: u8,
}

/// The range of the paper.
static BIN_RANGE: [f64; 2] = [-1.5, 1.5];

/// The paper's features: six axes at 500 Hz, samples and histograms above 23 Hz.
#[no_mangle]
pub extern "C" fn gid_spec_default() -> gid_spec {
    let spec = FeatureSpec::default();
    gid_spec {
        n_axes: 6,
        rate_hz: spec.rate_hz,
        cutoff_hz: spec.cutoff_hz,
        order: spec.order,
        n_bins: spec.n_bins,
        bin_ranges: BIN_RANGE.as_ptr(),
        n_bin_ranges: 1,
        clip: 0,
        density: 0,
        steady: 0,
        raw: 1,
        hfmh: 1,
    }
}

/// An extractor, and the shape of `n` values.
unsafe fn extractor(spec: *const gid_spec, n: usize) -> Result<(Extractor, BatchShape), gid_status> {
    check_pointer(spec, "spec")?;
    // SAFETY: the caller promises one.
    let spec = unsafe { spec.read() };
    let n_ends = spec.n_bin_ranges.saturating_mul(2);
    // SAFETY: as the header says.
    let ends = unsafe { slice(spec.bin_ranges, n_ends, "bin_ranges") }?;
    let n_axes = spec.n_axes;
    if n_axes == 0 || !n.is_multiple_of(n_axes) {
        return Err(failed(GID_SIZE, format_args!("n = {n} is no number of rows of n_axes = {n_axes}")));
    }
    let wanted = FeatureSpec::default()
        .with_rate_hz(spec.rate_hz)
        .with_cutoff_hz(spec.cutoff_hz)
        .with_order(spec.order)
        .with_n_bins(spec.n_bins)
        .with_bin_ranges(ends.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect())
        .with_outside(if spec.clip == 0 { Outside::Drop } else { Outside::Clip })
        .with_density(spec.density != 0)
        .with_initial(if spec.steady == 0 { Initial::Zero } else { Initial::Steady })
        .with_raw(spec.raw != 0)
        .with_hfmh(spec.hfmh != 0);
    let extractor = Extractor::new(wanted).map_err(|error| refused(&error))?;
    Ok((extractor, BatchShape { n_recordings: 1, n_samples: n / n_axes, n_axes }))
}

/// How many features `gid_extract` writes for a recording of `n` values.
#[no_mangle]
pub unsafe extern "C" fn gid_n_features(
    spec: *const gid_spec,
    n: usize,
    n_features: *mut usize,
) -> gid_status {
    guarded(|| {
        // SAFETY: as the header says.
        let (extractor, shape) = unsafe { extractor(spec, n) }?;
        let found = extractor.check_len(n, shape).map_err(|error| refused(&error))?;
        // SAFETY: as the header says.
        unsafe { write(n_features, "n_features", found) }
    })
}

/// Features of a recording of `n` values, row by row, into `features`, which has room for `n_features`: samples axis by axis,
/// then the histograms. On an error they hold unspecified numbers. Not for a real-time loop: it designs the filter, and
/// allocates.
#[no_mangle]
pub unsafe extern "C" fn gid_extract(
    spec: *const gid_spec,
    rows: *const f64,
    n: usize,
    features: *mut f64,
    n_features: usize,
) -> gid_status {
    guarded(|| {
        // SAFETY: as the header says.
        let (extractor, shape) = unsafe { extractor(spec, n) }?;
        // SAFETY: as the header says.
        let (rows, out) = unsafe { (slice(rows, n, "rows")?, slice_mut(features, n_features, "features")?) };
        extractor.extract_into(rows, shape, 1, out).map_err(|error| refused(&error))?;
        Ok(GID_OK)
    })
}
