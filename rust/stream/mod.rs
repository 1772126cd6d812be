//! Features and answers while samples arrive.
