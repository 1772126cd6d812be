//! The 8-lane kernel: many channels at once, in blocks that stay in the first-level cache.
//!
//! A *lane* is one channel of one recording. Lanes never mix, and every lane goes through the same operations
//! in the same order as [`SosState`](crate::SosState), so the width of the machine's vectors cannot change
//! a bit. The bodies are loops over `[f64; 8]`; thin wrappers compile them for the baseline (SSE2 or NEON), for
//! AVX2 and for AVX-512, and [`SimdPath`] picks one at run time. What only one instruction set can do asks its token
//! for a proof that the machine has these instructions.

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
mod dispatch;
mod filter;
mod simd;
mod transpose;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(crate) use count::{Counting, LaneBins, LaneHistograms};
pub use dispatch::SimdPath;
pub(crate) use filter::{Cascade, Overlap};
#[cfg(test)]
pub(crate) use simd::Portable;
pub(crate) use simd::{F32x8, Job, Pack, Simd};
pub(crate) use transpose::{
    finish_writes, pack, prefetch, transpose6, unpack, Raw, Row, BLOCK, LANES, MAX_WIDTH,
};
