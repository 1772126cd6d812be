//! The streaming wrench buffer: one writer, any number of readers, the oldest overwritten.
//!
//! All memory is taken when a buffer is made. The [`Writer`] never blocks, whatever readers do; each [`Reader`] has a
//! place of its own and learns exactly how many rows it missed. Rows are never torn and never silently joined: a read and
//! a [`Window`] lie in one epoch of device time, and the length of every gap is kept with the row after it.
//!
//! ```
//! use granular_id::buffer::{wrench_buffer, BufferSpec, BufferedRow, Pushed, Row, WindowSpec};
//!
//! let (mut writer, mut reader) = wrench_buffer(BufferSpec { tick_hz: 500.0, ..BufferSpec::default() })?;
//! for ticks in [0, 1, 2, 4] {
//!     let row = Row { ticks, host_ns: 2_000_000 * ticks, wrench: [0.0, 0.0, -5.0, 0.0, 0.0, 0.0], flags: 0 };
//!     assert_eq!(writer.push(&row), Pushed::Written);
//! }
//! let mut rows = [BufferedRow::EMPTY; 100];
//! let taken = reader.read(&mut rows);
//! assert_eq!((taken.n_rows, taken.missed), (4, 0));
//! assert_eq!(rows[3].missing_before, 1);
//! let refused = reader.window(&WindowSpec::whole(4)).unwrap_err();
//! assert!(refused.to_string().contains("got one of 1"));
//! # Ok::<(), granular_id::Error>(())
//! ```

mod clock;
mod counters;
mod envelope;
mod holding;
mod reader;
mod ring;
mod row;
mod shared;
mod spec;
mod window;
mod writer;

use std::sync::Arc;

pub use clock::host_ns;
pub use counters::Stats;
pub use reader::{Reader, Taken};
pub use row::{BufferedRow, Row};
pub use spec::{BufferSpec, MAX_REORDER_DEPTH, MAX_ROWS};
pub use window::{Fill, Window, WindowError, WindowSpec};
pub use writer::{Pushed, Writer};

/// A new buffer: its one writer, and a reader from the first row on.
///
/// # Errors
/// When a rate is not positive and finite, ticks come more slowly than rows, or the size is out of range.
pub fn wrench_buffer(spec: BufferSpec) -> crate::Result<(Writer, Reader)> {
    let shared = Arc::new(shared::Shared::new(spec)?);
    Ok((Writer::new(Arc::clone(&shared)), Reader::new(shared)))
}
