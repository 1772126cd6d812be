//! Streaming extraction and identification: unpack, call, map the error.
