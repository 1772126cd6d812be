//! How unlike all materials of a model a recording is.

use super::tensor::Tensor;
use super::ModelError;
use crate::error::short_number;
use crate::kernel::{Job, Simd, SimdPath};
use crate::memory::filled;

/// What the novelty of a recording is computed with: R directions, numbers rounded to float32.
#[derive(Clone, Debug)]
pub struct NoveltyParts<'a> {
    /// Centre and factor of each feature (2, D): a scaled feature is `(x - centre) * factor`.
    pub scaling: Tensor<'a>,
    /// Directions of scaled features in which the classes differ (R, D).
    pub directions: Tensor<'a>,
    /// Mean scaled features of each class (K, D).
    pub means: Tensor<'a>,
}

/// The novelty score of a recording: `min_k (w_d d_k + w_e e_k)`, the distance to the nearest of some class means, small for
/// what is like one of them.
///
/// With `s = (x - centre) * factor` the scaled features, `d_k` is the squared distance to the mean of class k along
/// directions in which the classes differ, `e_k` that over all features. Sums run over the features in the order of the scores.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Novelty {
    n_directions: usize,
    n_classes: usize,
    /// Centre and factor of each feature, raw ones sample by sample.
    scaling: Vec<[f32; 2]>,
    /// For each feature its part of each direction, then of each mean.
    rows: Vec<f32>,
    /// Where each mean lies along the directions.
    places: Vec<f64>,
}

impl Novelty {
    /// From tensors whose features stand as in the weights of a model; refuses other shapes, NaN and infinity.
    pub(super) fn new(
        parts: &NoveltyParts<'_>,
        n_classes: usize,
        n_features: usize,
        feature_of: impl Fn(usize) -> usize,
    ) -> Result<Self, ModelError> {
        let NoveltyParts { scaling, directions, means } = parts;
        let n_directions = directions.shape().first().copied().unwrap_or(0);
        for (name, tensor, n_rows, each) in [
            ("unknown_scaling", scaling, 2, "centre and factor"),
            ("unknown_directions", directions, n_directions, "directions"),
            ("unknown_means", means, n_classes, "one per class"),
        ] {
            let wanted = format_args!("({n_rows}, {n_features}), {each}");
            tensor.check_shape(name, &[n_rows, n_features], wanted)?;
        }
        let width = n_directions + n_classes;
        let mut rows = filled(0.0, width.saturating_mul(n_features))?;
        let mut places = filled(0.0, n_classes * n_directions)?;
        for (row, values) in rows.chunks_exact_mut(width).enumerate() {
            let at =
                |name, tensor: &Tensor<'_>, index| single(name, tensor, index * n_features + feature_of(row));
            for (index, value) in values.iter_mut().enumerate() {
                *value = match index.checked_sub(n_directions) {
                    None => at("unknown_directions", directions, index)?,
                    Some(class) => at("unknown_means", means, class)?,
                };
            }
            let (directions, means) = values.split_at(n_directions);
            for (mean, places) in means.iter().zip(places.chunks_exact_mut(n_directions.max(1))) {
                for (direction, place) in directions.iter().zip(places) {
                    *place += f64::from(*direction) * f64::from(*mean);
                }
            }
        }
        let pair = |row| {
            let at = |index| single("unknown_scaling", scaling, index * n_features + feature_of(row));
            Ok([at(0)?, at(1)?])
        };
        let pairs = (0..n_features).map(pair).collect::<Result<Vec<_>, ModelError>>()?;
        Ok(Self { n_directions, n_classes, scaling: pairs, rows, places })
    }

    /// Scaling, directions and means as tensors: rows of each and its values, features by `row_of`.
    pub(super) fn tensors(&self, row_of: impl Fn(usize) -> usize) -> [(usize, Vec<f32>); 3] {
        let n_features = self.scaling.len();
        let values = |n_rows: usize, at: &dyn Fn(usize, usize) -> f32| {
            let places = (0..n_rows).flat_map(|index| (0..n_features).map(move |feature| (index, feature)));
            (n_rows, places.map(|(index, feature)| at(index, row_of(feature))).collect())
        };
        let part = |index, row| self.rows[row * self.width() + index];
        [
            values(2, &|index, row| self.scaling[row][index]),
            values(self.n_directions, &part),
            values(self.n_classes, &|class, row| part(self.n_directions + class, row)),
        ]
    }

    /// Sums of a recording: along each direction, and of squared distances to each mean.
    pub(super) fn width(&self) -> usize {
        self.n_directions + self.n_classes
    }

    /// Adds features to the sums, from the one in place `first` on.
    pub(super) fn add(&self, path: SimdPath, sums: &mut [f64], first: usize, values: &[f64]) {
        path.run(AddFeatures { novelty: self, sums, first, values });
    }

    /// The score of the sums of all features.
    pub(super) fn score(&self, sums: &[f64], [of_d, of_e]: [f64; 2]) -> f64 {
        let (along, squares) = sums.split_at(self.n_directions);
        let each = squares.iter().enumerate().map(|(class, e)| {
            let place = &self.places[class * self.n_directions..][..self.n_directions];
            let d = along.iter().zip(place).fold(0.0, |sum, (u, place)| sum + (u - place) * (u - place));
            of_d * d + of_e * e
        });
        // What is no number is like nothing.
        each.fold(f64::INFINITY, f64::min)
    }
}

#[allow(clippy::cast_possible_truncation)] // what the file holds
fn single(name: &str, tensor: &Tensor<'_>, index: usize) -> Result<f32, ModelError> {
    let value = tensor.finite(name, index)? as f32;
    if value.is_finite() {
        return Ok(value);
    }
    Err(ModelError::must_be(name, "in the range of float32", short_number(tensor.at(index))))
}

struct AddFeatures<'a> {
    novelty: &'a Novelty,
    sums: &'a mut [f64],
    first: usize,
    values: &'a [f64],
}

impl Job for AddFeatures<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _simd: S) {
        let Self { novelty, sums, first, values } = self;
        let width = novelty.width();
        let (along, squares) = sums.split_at_mut(novelty.n_directions);
        let scaling = novelty.scaling[first..].iter();
        let rows = novelty.rows[first * width..].chunks_exact(width);
        for ((value, [centre, factor]), row) in values.iter().zip(scaling).zip(rows) {
            let scaled = (value - f64::from(*centre)) * f64::from(*factor);
            let (directions, means) = row.split_at(novelty.n_directions);
            for (sum, direction) in along.iter_mut().zip(directions) {
                *sum += scaled * f64::from(*direction);
            }
            for (sum, mean) in squares.iter_mut().zip(means) {
                let off = scaled - f64::from(*mean);
                *sum += off * off;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two classes, one direction, three features of which the first two stand the other way round in the file.
    #[test]
    fn the_score_is_the_weighted_distance_to_the_nearest_mean() {
        let tensor = |values: &'static [f64]| Tensor::new(vec![values.len() / 3, 3], values);
        let parts = NoveltyParts {
            scaling: tensor(&[1.0, 0.0, 0.0, 2.0, 1.0, 1.0]),
            directions: tensor(&[1.0, 0.0, -1.0]),
            means: tensor(&[0.0, 0.0, 0.0, 4.0, 1.0, 2.0]),
        };
        let novelty = Novelty::new(&parts, 2, 3, |row| [1, 0, 2][row]).unwrap();
        let [scaling, directions, means] = novelty.tensors(|feature| [1, 0, 2][feature]);
        assert_eq!(scaling, (2, vec![1.0, 0.0, 0.0, 2.0, 1.0, 1.0]));
        assert_eq!(directions, (1, vec![1.0, 0.0, -1.0]));
        assert_eq!(means, (2, vec![0.0, 0.0, 0.0, 4.0, 1.0, 2.0]));
        let (path, mut sums) = (SimdPath::detect().unwrap(), vec![0.0; novelty.width()]);
        // Scaled features, as in the file: 4, 3, 1.
        novelty.add(path, &mut sums, 0, &[3.0, 3.0]);
        novelty.add(path, &mut sums, 2, &[1.0]);
        assert_eq!(sums, [3.0, 26.0, 5.0]);
        assert_eq!(novelty.score(&sums, [2.0, 1.0]), f64::min(2.0 * 9.0 + 26.0, 2.0 * 1.0 + 5.0));
    }

    #[test]
    fn numbers_beyond_float32_are_refused() {
        let huge = [1e300; 2];
        let parts = |scaling| NoveltyParts {
            scaling: Tensor::new(vec![2, 1], scaling),
            directions: Tensor::new(vec![0, 1], &[]),
            means: Tensor::new(vec![1, 1], &[0.5]),
        };
        let error = Novelty::new(&parts(&huge), 1, 1, |row| row).unwrap_err();
        assert_eq!(error.to_string(), "unknown_scaling must be in the range of float32, got 1e300");
        let novelty = Novelty::new(&parts(&[0.0, 1.0]), 1, 1, |row| row).unwrap();
        assert_eq!(novelty.score(&[4.0], [1.0, 0.5]), 2.0);
    }
}
