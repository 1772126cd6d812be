//! A trained identifier: linear error-correcting output codes over features, and its file.
