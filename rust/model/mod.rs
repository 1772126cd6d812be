//! What a trained identifier is at run time: features, linear learners, output codes, classes; and its file.
//!
//! Nothing here learns. A [`Model`] is checked once, when it is made or read, and never changes: it may be shared between
//! threads, and none of its methods panics.
//!
//! **The order of addition** is part of what a model is, so that a stream, a batch and any other reader of the file give the
//! same bits. For each learner, with `x` the wrench and `h` the histogram features:
//!
//! ```text
//! raw = 0;  for sample: for axis: raw += coef[axis * n_samples + sample] * x[sample, axis]
//! hist = 0; for j, where h[j] != 0: hist += coef[n_raw + j] * h[j]
//! score = (intercept + raw) + hist
//! ```
//!
//! Multi-band features stand in the place of `h`, in their order, and there are no raw ones.

mod checks;
mod codes;
mod extraction;
mod fault;
mod file;
mod loss;
mod nearest;
mod notes;
mod parts;
mod rules;
mod scores;
mod trained;
mod weights;

#[doc(hidden)]
pub use extraction::Extraction;
pub use extraction::{Features, MAX_MULTIBAND_AXES, MAX_MULTIBAND_VALUES};
pub use fault::{Fault, FileFault};
pub use file::{MAX_FILE_BYTES, MAX_HEADER_BYTES};
pub use loss::{Decoding, Loss};
pub use nearest::NearestMean;
pub use notes::{Notes, MAX_NAME_BYTES};
pub use parts::{ModelParts, Tensor, MAX_AXES, MAX_BINS_IN_ALL, MAX_CLASSES, MAX_WINDOW};
pub use rules::Rules;
pub(crate) use rules::Verdict;
pub(crate) use scores::best_and_margin;
#[doc(hidden)]
pub use scores::ranking;
pub use scores::Answer;
pub use trained::Model;
pub(crate) use weights::AddRows;
