//! Scores of multi-band features: what can be added up is, as rows arrive; the rest is computed whenever somebody asks.

use super::window::Window;
use super::windows::Windows;
use crate::error::Result;
use crate::kernel::SimdPath;
use crate::memory::filled;
use crate::model::{AddRows, Model};
use crate::multiband::{MultiBand, Workspace};

/// The rows of a window, what is known of them already, and room for their features.
#[derive(Clone, Debug)]
pub(super) struct Banded {
    window: Window,
    multiband: MultiBand,
    work: Workspace,
    features: Vec<f64>,
    sums: Vec<f64>,
    path: SimdPath,
}

impl Banded {
    pub(super) fn new(model: &Model, multiband: &MultiBand, windows: Windows) -> Result<Self> {
        Ok(Self {
            window: Window::new(windows)?,
            work: multiband.workspace()?,
            features: filled(0.0, multiband.n_features())?,
            sums: filled(0.0, model.lanes())?,
            path: SimdPath::detect()?,
            multiband: multiband.clone(),
        })
    }

    pub(super) fn window(&self) -> &Window {
        &self.window
    }

    pub(super) fn push(&mut self, rows: &[f64]) -> Result<usize> {
        let n_taken = self.window.push(rows, self.multiband.limits())?;
        // A bounded time per push: rows that windows share are caught up with by and by.
        if n_taken > 0 && self.window.n_seen() > 0 {
            self.multiband.advance(self.window.rows(), &mut self.work, n_taken)?;
        }
        Ok(n_taken)
    }

    /// Goes on to the next window, which is a recording of its own.
    pub(super) fn advance(&mut self) -> Result<()> {
        self.window.advance()?;
        self.work.restart();
        Ok(())
    }

    pub(super) fn reset(&mut self) {
        self.window.reset();
        self.work.restart();
    }

    /// Scores of the learners from the rows so far; before the first the intercepts.
    pub(super) fn scores(&mut self, model: &Model, out: &mut [f64]) -> Result<()> {
        self.sums.fill(0.0);
        if self.window.n_seen() > 0 {
            self.multiband.finish_into(self.window.rows(), &mut self.work, &mut self.features)?;
            let (rows, values) = (model.rows_from(0), &self.features);
            self.path.run(AddRows { sums: &mut self.sums, rows, values, scale: 1.0 });
        }
        for ((score, sum), intercept) in out.iter_mut().zip(&self.sums).zip(model.intercept()) {
            *score = intercept + sum;
        }
        Ok(())
    }
}
