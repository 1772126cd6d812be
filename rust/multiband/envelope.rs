//! Energy of a band over time.
