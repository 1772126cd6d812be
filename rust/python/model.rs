//! Trained models and their files: unpack, call, map the error.
