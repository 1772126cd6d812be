//! The RDT receiver: unpack, call, map the error.
