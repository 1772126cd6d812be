//! What the benches time and nobody can call: no promise to anybody else.

use crate::dsp::Sos;
use crate::kernel::{Cascade, Job, Row, Simd, SimdPath, BLOCK, LANES, MAX_WIDTH};

/// Blocks of rows that are filtered again and again: they stay in the first-level cache.
const BLOCKS: usize = 8;

/// The filter of the kernel at its full width, without what is done beside it.
pub struct FilterLanes {
    cascade: Cascade<MAX_WIDTH>,
    blocks: Vec<[Row<MAX_WIDTH>; BLOCK]>,
}

impl FilterLanes {
    /// A filter at rest, and the first of these values.
    #[must_use]
    pub fn new(sos: &Sos, values: &[f64]) -> Self {
        let mut blocks = vec![[Row::ZERO; BLOCK]; BLOCKS];
        let rows = blocks.iter_mut().flatten().flat_map(Row::flat_mut);
        rows.zip(values).for_each(|(to, value)| *to = *value);
        Self { cascade: Cascade::new(sos), blocks }
    }

    /// Values in so many rows.
    #[must_use]
    pub const fn n_values(&self, n_rows: usize) -> usize {
        n_rows * MAX_WIDTH * LANES
    }

    /// Filters so many rows, a multiple of the block; returns a sum that keeps them from being left out.
    pub fn filter(&mut self, path: SimdPath, n_rows: usize) -> f64 {
        path.run(Filter { lanes: self, n_blocks: n_rows / BLOCK })
    }
}

struct Filter<'a> {
    lanes: &'a mut FilterLanes,
    n_blocks: usize,
}

impl Job for Filter<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> f64 {
        let FilterLanes { cascade, blocks } = self.lanes;
        let mut sum = 0.0;
        for index in 0..self.n_blocks {
            let mut block = blocks[index % BLOCKS];
            cascade.filter(simd, &mut block, &mut ());
            sum += std::hint::black_box(&block)[0].flat()[0];
        }
        sum
    }
}
