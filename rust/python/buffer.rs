//! The wrench buffer: unpack, call, map the error.
