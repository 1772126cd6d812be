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
            if from == to {
                continue;
            }
            let cells = out.iter_mut().skip(stretch).step_by(self.stretches);
            for (axis, (cell, scale)) in cells.zip(scales).enumerate() {
                let samples = recording[from * self.n_axes..to * self.n_axes].iter().skip(axis);
                let sum: f64 = samples.step_by(self.n_axes).sum();
                *cell = libm::asinh(sum / (to - from) as f64 / scale);
            }
        }
    }
}
