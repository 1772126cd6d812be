//! The level of a recording: coarse means of the signal itself.

/// Stretches of time of equal length, or one less.
const STRETCHES: usize = 16;

/// arcsinh of the mean of each stretch, in units of the scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    n_axes: usize,
    stretches: usize,
}

impl Level {
    pub(super) fn new(n_axes: usize, n_samples: usize) -> Self {
        Self { n_axes, stretches: STRETCHES.min(n_samples) }
    }

    /// Features of each axis.
    pub(super) fn stretches(&self) -> usize {
        self.stretches
    }

    pub(super) fn n_features(&self) -> usize {
        self.n_axes * self.stretches
    }

    /// Axis by axis. A stretch without samples, in a recording that has only begun, is at zero.
    #[inline(always)]
    pub(super) fn compute(&self, recording: &[f64], scales: &[f64], out: &mut [f64]) {
        let n_seen = recording.len() / self.n_axes;
        out.fill(0.0);
        for stretch in 0..self.stretches {
            let [from, to] = [stretch, stretch + 1].map(|i| i * n_seen / self.stretches);
            let samples = &recording[from * self.n_axes..to * self.n_axes];
            for row in samples.chunks_exact(self.n_axes) {
                for (axis, x) in row.iter().enumerate() {
                    out[axis * self.stretches + stretch] += x;
                }
            }
        }
        for (axis, out) in out.chunks_exact_mut(self.stretches).enumerate() {
            for (stretch, cell) in out.iter_mut().enumerate() {
                let [from, to] = [stretch, stretch + 1].map(|i| i * n_seen / self.stretches);
                *cell = libm::asinh(*cell / (to - from).max(1) as f64 / scales[axis]);
            }
        }
    }
}
