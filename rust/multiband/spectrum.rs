//! Power over frequency.
