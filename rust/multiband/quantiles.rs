//! Distribution of the values of a band.
