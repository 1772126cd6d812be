//! Scores of multi-band features: computed from the rows that are there whenever somebody asks.

use super::window::Window;
use super::windows::Windows;
use crate::error::Result;
use crate::lanes::Path;
use crate::model::{AddRows, Model};
use crate::multiband::{MultiBand, Workspace};

/// The rows of a window and room for their features.
#[derive(Clone, Debug)]
pub(super) struct Banded {
    pub(super) window: Window,
    multiband: MultiBand,
    work: Workspace,
    features: Vec<f64>,
    sums: Vec<f64>,
    path: Path,
}

impl Banded {
    pub(super) fn new(model: &Model, multiband: &MultiBand, windows: Windows) -> Result<Self> {
        Ok(Self {
            window: Window::new(windows)?,
            work: multiband.workspace(),
            features: vec![0.0; multiband.n_features()],
            sums: vec![0.0; model.lanes()],
            path: Path::detect(),
            multiband: multiband.clone(),
        })
    }

    /// Scores of the learners from the rows so far; before the first the intercepts.
    pub(super) fn scores(&mut self, model: &Model, out: &mut [f64]) -> Result<()> {
        self.sums.fill(0.0);
        if self.window.n_seen() > 0 {
            self.multiband.extract_into(self.window.rows(), &mut self.work, &mut self.features)?;
            let (rows, values) = (model.rows_from(0), &self.features);
            self.path.run(AddRows { sums: &mut self.sums, rows, values, scale: 1.0 });
        }
        for ((score, sum), intercept) in out.iter_mut().zip(&self.sums).zip(model.intercept()) {
            *score = intercept + sum;
        }
        Ok(())
    }
}
