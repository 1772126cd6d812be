//! The 8-lane kernel: many channels at once, in blocks that stay in the first-level cache.
//!
//! A *lane* is one channel of one recording. Lanes never mix, and every lane goes through the same operations
//! in the same order as [`SosState`](crate::SosState), so the width of the machine's vectors cannot change
//! a bit. The bodies are loops over `[f64; 8]`; thin wrappers compile them for the baseline (SSE2 or NEON), for
//! AVX2 and for AVX-512, and [`SimdPath`] picks one at run time.

/// Runs a block for each vector `w` of a row. Written out, because a compiler keeps so short a loop rolled, and then
/// passes the vectors through memory instead of registers; and a closure would lose the features of the wrapper.
macro_rules! each_vector {
    ($width:ident, $w:ident, $work:block) => {
        const { assert!($width >= 1 && $width <= $crate::kernel::MAX_WIDTH) };
        let $w = 0;
        $work
        if $width > 1 {
            let $w = 1;
            $work
        }
        if $width > 2 {
            let $w = 2;
            $work
        }
    };
}

mod count;
mod filter;
mod pack;
mod quad;
mod simd;
mod transpose;
#[cfg(target_arch = "x86_64")]
mod x86;
#[cfg(target_arch = "x86_64")]
mod x86_quad;

pub(crate) use count::{Counting, LaneBins, LaneHistograms};
pub(crate) use filter::{Beside, Cascade};
pub(crate) use pack::{Mask, Pack};
pub(crate) use quad::Quad;
pub use simd::SimdPath;
pub(crate) use simd::{Isa, Job};
pub(crate) use transpose::{pack, unpack, Raw, Real};

/// Channels per vector.
pub(crate) const LANES: usize = 8;

/// Vectors per row. Three vectors are 24 lanes, four 6-axis recordings: enough independent work to hide the
/// latency of the filter's recurrence.
pub(crate) const MAX_WIDTH: usize = 3;

/// Rows per block: eight float64 are one cache line of an output that is written axis by axis.
pub(crate) const BLOCK: usize = 8;

/// Eight channels at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Vector(pub(crate) [f64; LANES]);

/// One instant of `W * LANES` channels.
pub(crate) type Row<const W: usize> = [Vector; W];

impl Vector {
    pub(crate) const ZERO: Self = Self([0.0; LANES]);
}

/// The lanes of a row side by side.
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn flat<const W: usize>(row: &Row<W>) -> &[f64] {
    // SAFETY: `Vector` is `repr(C)` and holds exactly eight f64 without padding (its size is its alignment).
    unsafe { std::slice::from_raw_parts(row.as_ptr().cast(), W * LANES) }
}

/// The lanes of a row side by side, to be written.
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn flat_mut<const W: usize>(row: &mut Row<W>) -> &mut [f64] {
    // SAFETY: as in `flat`; the exclusive borrow is passed on.
    unsafe { std::slice::from_raw_parts_mut(row.as_mut_ptr().cast(), W * LANES) }
}
