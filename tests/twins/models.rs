//! Models with random weights.

use granular_id::model::{Decoding, Loss, ModelParts, Notes, Tensor};
use granular_id::{FeatureSpec, Model};

use crate::signals::uniform;

/// One-vs-one, with everything that provisional answers and bounds need.
pub fn random_model(n_classes: usize, n_samples: usize, n_axes: usize, spec: FeatureSpec) -> Model {
    let mut noise = uniform(9);
    let pairs: Vec<_> = (0..n_classes).flat_map(|a| (a + 1..n_classes).map(move |b| (a, b))).collect();
    let n_raw = if spec.raw { n_samples * n_axes } else { 0 };
    let n_features = n_raw + if spec.hfmh { n_axes * spec.n_bins } else { 0 };
    let n_learners = pairs.len();
    let coef: Vec<f64> = (0..n_learners * n_features).map(|_| noise()).collect();
    let intercept: Vec<f64> = (0..n_learners).map(|_| noise()).collect();
    let mut codes = vec![0.0; n_classes * n_learners];
    for (learner, (a, b)) in pairs.iter().enumerate() {
        codes[a * n_learners + learner] = 1.0;
        codes[b * n_learners + learner] = -1.0;
    }
    let mean: Vec<f64> = (0..n_raw).map(|_| noise()).collect();
    let low: Vec<f64> = mean.iter().map(|mean| mean - 0.1).collect();
    let high: Vec<f64> = mean.iter().map(|mean| mean + 0.1).collect();
    let of_raw = |values| spec.raw.then(|| Tensor::new(vec![n_raw], values));
    Model::new(ModelParts {
        n_samples,
        n_axes,
        coef: Tensor::new(vec![n_learners, n_features], &coef),
        intercept: Tensor::new(vec![n_learners], &intercept),
        coding_matrix: Tensor::new(vec![n_classes, n_learners], &codes),
        classes: (0..n_classes).map(|class| format!("material {class}")).collect(),
        loss: Loss::Hinge,
        decoding: Decoding::LossWeighted,
        raw_mean: of_raw(&mean),
        raw_low: of_raw(&low),
        raw_high: of_raw(&high),
        early: Some(Tensor::new(vec![1, 2], &[1.0, 0.5])),
        sigmoid: None,
        posterior_weights: None,
        notes: Notes::of_axes(n_axes),
        spec,
    })
    .unwrap()
}
