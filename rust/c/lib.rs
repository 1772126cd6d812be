//! The C interface. Its header is `include/granular_id.h`, which cbindgen makes of these files.
//!
//! A function takes its handles, slices and strings apart, calls the core and maps the error. Handles are numbers, looked up
//! in tables: one that was freed or never made is refused. No panic leaves a function.

// This is what pointers come in by.
#![allow(unsafe_code)]
// The names are those of C.
#![allow(non_camel_case_types)]
// The header says it once for all functions: pointers are null or lead to as many values as the length beside them.
#![allow(clippy::missing_safety_doc)]

pub mod extract;
mod last_error;
pub mod model;
pub mod stream;

#[cfg(test)]
mod tests;

use std::ffi::c_char;
use std::panic::{catch_unwind, AssertUnwindSafe};

use granular_id::model::MAX_CLASSES;
use granular_id::Error;
use last_error::failed;

/// How a call ended. Other values than 0 and 1 are errors: nothing has changed, nothing was written (but by `gid_extract`),
/// and `gid_last_error` has a sentence about it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum gid_status {
    /// Done.
    GID_OK = 0,
    /// No error: the window was complete before the last of the rows, which were not taken.
    GID_FULL = 1,
    /// A pointer is null, or not aligned for its type.
    GID_NULL = 2,
    /// A length that does not fit the others, or an index beyond the end.
    GID_SIZE = 3,
    /// A value that nothing can be done with: NaN, infinity, too large, outside its range.
    GID_VALUE = 4,
    /// A handle that was freed, or never made.
    GID_HANDLE = 5,
    /// Another thread is in a call on this stream.
    GID_BUSY = 6,
    /// A file that cannot be read.
    GID_FILE = 7,
    /// Bytes that are no model: damaged, cut off, of another version, or something else.
    GID_MODEL = 8,
    /// No memory, or `GID_MAX_STREAMS` streams are there.
    GID_MEMORY = 9,
    /// A bug in this library. Free the handles of the call.
    GID_PANIC = 10,
}

/// The most streams at a time in a process.
pub const GID_MAX_STREAMS: usize = 256;

/// Bytes of the candidates of a decision: a bit for each class, of which a model has at most 1024.
pub const GID_CANDIDATE_BYTES: usize = 128;

const _: () = assert!(MAX_CLASSES == 8 * GID_CANDIDATE_BYTES);

/// The version of this library, "0.1.0".
#[no_mangle]
pub extern "C" fn gid_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// Copies the sentence about the last error of this thread, UTF-8, at most `n` bytes with the final zero; empty before the first
/// error. Returns its length without the zero: where that is `n` or more, it was cut. `text` may be null if `n` is 0.
#[no_mangle]
pub unsafe extern "C" fn gid_last_error(text: *mut c_char, n: usize) -> usize {
    // SAFETY: as the header says.
    unsafe { last_error::copy(text.cast(), n) }
}

/// The outcome of a call that wants no panic to leave it. Errors have left their sentence already.
fn guarded(call: impl FnOnce() -> Result<gid_status, gid_status>) -> gid_status {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(status) | Err(status)) => status,
        Err(_) => failed(gid_status::GID_PANIC, format_args!("a bug in granular_id: please report it")),
    }
}

/// Stores the sentence of an error of the core, and gives its status.
fn refused(error: &Error) -> gid_status {
    let status = match error {
        Error::Length { .. } | Error::Empty { .. } => gid_status::GID_SIZE,
        Error::Memory { .. } => gid_status::GID_MEMORY,
        _ => gid_status::GID_VALUE,
    };
    failed(status, format_args!("{error}"))
}

/// Refuses a pointer that leads to no `T`.
fn check_pointer<T>(pointer: *const T, name: &str) -> Result<(), gid_status> {
    if pointer.is_null() {
        return Err(failed(gid_status::GID_NULL, format_args!("{name} must not be null")));
    }
    if !pointer.is_aligned() {
        let wanted = align_of::<T>();
        return Err(failed(gid_status::GID_NULL, format_args!("{name} must be aligned to {wanted} bytes")));
    }
    Ok(())
}

/// Refuses an array that cannot be.
fn check_array<T>(pointer: *const T, n: usize, name: &str) -> Result<(), gid_status> {
    check_pointer(pointer, name)?;
    if n > isize::MAX as usize / size_of::<T>() {
        return Err(failed(gid_status::GID_SIZE, format_args!("{name} cannot hold {n} values")));
    }
    Ok(())
}

/// A caller's values; of none the pointer is not looked at.
unsafe fn slice<'a, T>(pointer: *const T, n: usize, name: &str) -> Result<&'a [T], gid_status> {
    if n == 0 {
        return Ok(&[]);
    }
    check_array(pointer, n, name)?;
    // SAFETY: the caller promises so many values.
    Ok(unsafe { std::slice::from_raw_parts(pointer, n) })
}

/// A caller's room for values.
unsafe fn slice_mut<'a, T>(pointer: *mut T, n: usize, name: &str) -> Result<&'a mut [T], gid_status> {
    if n == 0 {
        return Ok(&mut []);
    }
    check_array(pointer, n, name)?;
    // SAFETY: the caller promises room for so many values, which nobody else uses during the call.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, n) })
}

/// Gives a caller a result.
unsafe fn write<T>(out: *mut T, name: &str, value: T) -> Result<gid_status, gid_status> {
    check_pointer(out, name)?;
    // SAFETY: the caller promises room for one.
    unsafe { out.write(value) };
    Ok(gid_status::GID_OK)
}
