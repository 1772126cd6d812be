//! Scores of multi-band features, which are computed when somebody asks.

use super::{Position, Windows};
use crate::error::{Error, Result};
use crate::kernel::SimdPath;
use crate::memory::filled;
use crate::model::{AddRows, Model};
use crate::multiband::{MultiBand, Workspace, TOO_LOUD};

/// The rows of a window, and room for their features.
#[derive(Clone, Debug)]
pub(super) struct MultiBandStream {
    position: Position,
    /// Room for the rows of a window, side by side as a recording has them.
    values: Vec<f64>,
    multiband: MultiBand,
    work: Workspace,
    features: Vec<f64>,
    sums: Vec<f64>,
    /// Sums of the novelty; empty where unknown materials are not refused.
    novelty: Vec<f64>,
    path: SimdPath,
}

impl MultiBandStream {
    pub(super) fn new(model: &Model, multiband: &MultiBand, windows: Windows) -> Result<Self> {
        windows.check(1)?;
        Ok(Self {
            position: Position::new(windows),
            values: filled(0.0, windows.n_samples * windows.n_axes)?,
            work: multiband.workspace()?,
            features: filled(0.0, multiband.n_features())?,
            sums: filled(0.0, model.lanes())?,
            novelty: filled(0.0, model.novelty_width())?,
            path: SimdPath::detect()?,
            multiband: multiband.clone(),
        })
    }

    pub(super) fn position(&self) -> &Position {
        &self.position
    }

    /// Takes rows of magnitudes up to the limit of each axis; on an error none.
    pub(super) fn push(&mut self, rows: &[f64]) -> Result<usize> {
        let Position { windows: Windows { n_axes, .. }, n_seen, ahead, .. } = self.position;
        let rows = self.position.taken(rows)?;
        let n_taken = rows.len() / n_axes;
        let passed = ahead.min(n_taken);
        let kept = &rows[passed * n_axes..];
        for (row, values) in (passed..).zip(kept.chunks_exact(n_axes)) {
            let mut limits = values.iter().zip(self.multiband.limits());
            if let Some(axis) = limits.position(|(value, limit)| value.abs() > *limit) {
                return Err(Error::TooLargeRow { row, axis, value: values[axis], limit: TOO_LOUD });
            }
        }
        self.values[n_seen * n_axes..][..kept.len()].copy_from_slice(kept);
        self.position.ahead -= passed;
        self.position.n_seen += n_taken - passed;
        Ok(n_taken)
    }

    /// Goes on to the next window, which is a recording of its own.
    pub(super) fn next_window(&mut self) -> Result<()> {
        let leaving = self.position.next_window()?;
        self.values.copy_within(leaving * self.position.windows.n_axes.., 0);
        Ok(())
    }

    pub(super) fn reset(&mut self) {
        self.position = Position::new(self.position.windows);
    }

    /// The novelty of the window whose scores were computed last.
    pub(super) fn novelty(&mut self, model: &Model) -> Option<f64> {
        self.novelty.fill(0.0);
        model.add_novelty(self.path, &mut self.novelty, 0, &self.features);
        model.novelty_of(&self.novelty)
    }

    /// Scores of the learners from the rows so far; before the first the intercepts.
    pub(super) fn scores(&mut self, model: &Model, out: &mut [f64]) -> Result<()> {
        self.sums.fill(0.0);
        if self.position.n_seen > 0 {
            let seen = &self.values[..self.position.n_seen * self.position.windows.n_axes];
            self.multiband.extract_on(self.path, seen, &mut self.work, &mut self.features)?;
            let (rows, values) = (model.rows_from(0), &self.features);
            self.path.run(AddRows { sums: &mut self.sums, rows, values, scale: 1.0 });
        }
        for ((score, sum), intercept) in out.iter_mut().zip(&self.sums).zip(model.intercept()) {
            *score = intercept + sum;
        }
        Ok(())
    }
}
