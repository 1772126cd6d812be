//! How axes move together in a band.
