//! The streaming buffer of a wrench, or of any other number of axes: one writer, any number of readers, the oldest
//! overwritten.
//!
//! All memory is taken when a buffer is made. The [`Writer`] never blocks, whatever readers do; each [`Reader`] has a
//! place of its own and learns exactly how many rows it missed. Rows are never torn and never silently joined: a read and
//! a [`Window`] lie in one epoch of device time, and the length of every gap is stored with the row after it.
//!
//! ```
//! use granular_id::buffer::{wrench_buffer, BufferSpec, BufferedRow, Pushed, Row, WindowSpec};
//!
//! let (mut writer, mut reader) = wrench_buffer(BufferSpec::default().with_tick_hz(500.0))?;
//! for ticks in [0, 1, 2, 4] {
//!     let row = Row { ticks, host_ns: 2_000_000 * ticks, wrench: [0.0, 0.0, -5.0, 0.0, 0.0, 0.0], flags: 0 };
//!     assert_eq!(writer.push(&row), Pushed::Written);
//! }
//! let mut rows = [BufferedRow::EMPTY; 100];
//! let taken = reader.read(&mut rows)?;
//! assert_eq!((taken.n_rows, taken.missed), (4, 0));
//! assert_eq!(rows[3].missing_before, 1);
//! let refused = reader.window(&WindowSpec::whole(4)).unwrap_err();
//! assert!(refused.to_string().contains("got one of 1"));
//! # Ok::<(), granular_id::Error>(())
//! ```

mod clock;
mod reader;
mod ring;
mod writer;

use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::Arc;

pub use clock::host_ns;
pub use reader::{Fill, Reader, Taken, Window, WindowError, WindowSpec};
pub use writer::{DeviceClock, Pushed, Writer};

use crate::error::{short_number, Error, Result};
use crate::specs::setters;
use crate::wrench::AXES;
use clock::{ClockLine, CLOCK_WORDS};
use ring::{Ring, Values};

/// A new buffer: its one writer, and a reader from the first row on.
///
/// # Errors
/// When a rate is not positive and finite, ticks come more slowly than rows, or the size or number of axes is out of range.
pub fn wrench_buffer(spec: BufferSpec) -> Result<(Writer, Reader)> {
    let buffer = Arc::new(Buffer::new(spec)?);
    Ok((Writer::new(Arc::clone(&buffer)), Reader::new(buffer)))
}

/// Rows that a buffer may hold: nine hours at 500 Hz.
pub const MAX_ROWS: usize = 1 << 24;

/// Largest number of rows that may wait for a late one.
pub const MAX_REORDER_DEPTH: usize = 1024;

/// Axes that a row may have: those of ten wrenches.
pub const MAX_AXES: usize = 64;

/// What a buffer is to hold.
///
/// ```
/// use granular_id::buffer::BufferSpec;
///
/// let spec = BufferSpec::default().with_rate_hz(7000.0).with_tick_hz(7000.0);
/// assert_eq!(spec.seconds, 10.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct BufferSpec {
    /// Nominal rate of the rows.
    pub rate_hz: f64,
    /// Time that the newest rows reach back; with the rate it gives the capacity.
    pub seconds: f64,
    /// Ticks of the device's clock per second, at least `rate_hz`.
    pub tick_hz: f64,
    /// Rows that wait for a late one at most. 0: a row that comes late is dropped and counted, and nothing ever waits.
    pub reorder_depth: usize,
    /// Values of a row, from 1 to [`MAX_AXES`]: 6 of a wrench.
    pub n_axes: usize,
}

impl Default for BufferSpec {
    fn default() -> Self {
        Self { rate_hz: 500.0, seconds: 10.0, tick_hz: 1e9, reorder_depth: 0, n_axes: AXES.len() }
    }
}

setters! {
    BufferSpec:
    with_rate_hz rate_hz f64,
    with_seconds seconds f64,
    with_tick_hz tick_hz f64,
    with_reorder_depth reorder_depth usize,
    with_n_axes n_axes usize,
}

impl BufferSpec {
    /// Rows the buffer holds: seconds times rate, rounded up.
    fn capacity(&self) -> Result<usize> {
        let Self { rate_hz, seconds, tick_hz, reorder_depth, n_axes } = *self;
        Error::check_rate(rate_hz)?;
        if !(tick_hz.is_finite() && tick_hz >= rate_hz) {
            let wanted = format_args!("be finite and at least rate_hz = {}", short_number(rate_hz));
            return Err(Error::argument("tick_hz", wanted, short_number(tick_hz)));
        }
        Error::check_range("reorder_depth", reorder_depth, 0..=MAX_REORDER_DEPTH)?;
        Error::check_range("n_axes", n_axes, 1..=MAX_AXES)?;
        let rows = (seconds * rate_hz).ceil();
        // NaN is in no range.
        if !(seconds > 0.0 && (1.0..=MAX_ROWS as f64).contains(&rows)) {
            let wanted = format_args!("be positive and give at most {MAX_ROWS} rows");
            let got = format_args!("{} at rate_hz = {}", short_number(seconds), short_number(rate_hz));
            return Err(Error::argument("seconds", wanted, got));
        }
        // Between 1 and MAX_ROWS.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        Ok(rows as usize)
    }

    /// Instants without a row between two rows of one epoch.
    #[inline]
    fn missing_between(&self, earlier: u64, later: u64) -> u32 {
        let periods = (later - earlier) as f64 * self.rate_hz / self.tick_hz;
        // Rounded by hand, as `round` is a call on processors without SSE4.1. The cast saturates, see
        // BufferedRow::missing_before.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let rounded = (periods + 0.5) as u64;
        u32::try_from(rounded.saturating_sub(1)).unwrap_or(u32::MAX)
    }
}

/// One measurement with its two time stamps. `W` holds its values: an array, or a slice where their number is not known
/// before the program runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row<W = [f64; 6]> {
    /// Device time, never wrapped; the unit is `1 / tick_hz` seconds.
    pub ticks: u64,
    /// When it arrived, by [`host_ns`].
    pub host_ns: u64,
    /// A value for each axis. Of six: forces in N, then torques in N m, in the order of [`AXES`].
    pub wrench: W,
    /// Bits of [`SAMPLE_FLAGS`](crate::wrench::SAMPLE_FLAGS).
    pub flags: u8,
}

impl<W> Row<W> {
    /// The same with these values.
    pub fn with<V>(&self, wrench: V) -> Row<V> {
        let &Self { ticks, host_ns, flags, .. } = self;
        Row { ticks, host_ns, wrench, flags }
    }
}

/// A row as a reader gets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BufferedRow<W = [f64; 6]> {
    /// What was pushed.
    pub row: Row<W>,
    /// Instants without a row between this one and the one before it in its epoch; `u32::MAX` stands for that many or
    /// more.
    pub missing_before: u32,
    /// Number of its epoch. Rows of two epochs have no common time axis.
    pub epoch: u32,
}

/// Words of a row in a slot, in front of its values.
const ROW_WORDS: usize = 4;

impl BufferedRow {
    /// A row of any content, to be overwritten: room for [`Reader::read`].
    pub const EMPTY: Self =
        Self { row: Row { ticks: 0, host_ns: 0, wrench: [0.0; 6], flags: 0 }, missing_before: 0, epoch: 0 };
}

impl<W> BufferedRow<W> {
    /// The same with these values.
    pub fn with<V>(&self, wrench: V) -> BufferedRow<V> {
        BufferedRow { row: self.row.with(wrench), missing_before: self.missing_before, epoch: self.epoch }
    }
}

/// A row without its values.
impl BufferedRow<()> {
    fn to_words(self) -> [u64; ROW_WORDS] {
        let place = u64::from(self.epoch) << 32 | u64::from(self.missing_before);
        [self.row.ticks, self.row.host_ns, place, self.row.flags.into()]
    }

    fn from_words([ticks, host_ns, place, flags]: [u64; ROW_WORDS]) -> Self {
        let [missing_before, epoch] = halves(place);
        let [flags, ..] = flags.to_le_bytes();
        Self { row: Row { ticks, host_ns, wrench: (), flags }, missing_before, epoch }
    }
}

/// The low and the high half of a word.
fn halves(word: u64) -> [u32; 2] {
    let [a, b, c, d, e, f, g, h] = word.to_le_bytes();
    [u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h])]
}

/// Counts of one thread: a public struct, and its twin of atomics that others read.
macro_rules! counters {
    ($(#[$about:meta])* $counts:ident, $cells:ident: $($(#[$doc:meta])* $name:ident,)*) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct $counts { $($(#[$doc])* pub $name: u64,)* }

        impl $counts {
            /// Names and counts, in order.
            #[must_use]
            pub fn named(&self) -> Vec<(&'static str, u64)> {
                vec![$((stringify!($name), self.$name),)*]
            }
        }

        /// On cache lines of their own, as what lies beside them is read all the time.
        #[derive(Debug, Default)]
        #[repr(align(128))]
        struct $cells { $($name: $crate::buffer::Counter,)* }

        impl $cells {
            fn load(&self) -> $counts {
                $counts { $($name: self.$name.get(),)* }
            }

            #[allow(dead_code)] // the buffer's are counted one by one
            fn store(&self, counts: &$counts) {
                $(self.$name.set(counts.$name);)*
            }
        }
    };
}
pub(crate) use counters;

counters! {
    /// Counts since the buffer was made. Each row pushed is in exactly one of `written`, `held`, `duplicates`, `late` and
    /// `non_finite`, unless it has a wrong number of values.
    #[non_exhaustive]
    Stats, Counters:
    /// Rows that readers got, or could have got.
    written,
    /// Rows that wait for a late one at this moment.
    held,
    /// Rows dropped because their device time was there already.
    duplicates,
    /// Rows dropped because later ones were written already.
    late,
    /// Rows that came after later ones and were put in order.
    reordered,
    /// Gaps between rows written.
    gaps,
    /// Instants without a row in those gaps.
    missing,
    /// New beginnings of device time after the first.
    epochs,
    /// Rows written with [`SATURATED`](crate::wrench::SATURATED).
    saturated,
    /// Rows written with [`BAD_STATUS`](crate::wrench::BAD_STATUS).
    bad_status,
    /// Rows dropped because a value was NaN or infinite.
    non_finite,
}

/// A count that one thread changes.
#[derive(Debug, Default)]
pub(crate) struct Counter(AtomicU64);

impl Counter {
    pub(crate) fn get(&self) -> u64 {
        self.0.load(Relaxed)
    }

    #[inline]
    pub(crate) fn add(&self, n: u64) {
        // A load and a store: cheaper than an atomic addition, and exact with one writer.
        self.set(self.get().wrapping_add(n));
    }

    #[inline]
    pub(crate) fn set(&self, n: u64) {
        self.0.store(n, Relaxed);
    }
}

/// Lines of the clock in the ring: the newest, and some for readers that are slower than the writer.
const CLOCK_LINES: usize = 8;

/// What the writer and the readers share.
struct Buffer {
    spec: BufferSpec,
    rows: Ring<ROW_WORDS>,
    /// The relation of device and host time, as it was last changed.
    clock: Ring<CLOCK_WORDS>,
    counters: Counters,
}

impl Buffer {
    fn new(spec: BufferSpec) -> Result<Self> {
        let (rows, clock) = (Ring::new(spec.capacity()?, spec.n_axes)?, Ring::new(CLOCK_LINES, 0)?);
        Ok(Self { spec, rows, clock, counters: Counters::default() })
    }

    /// Row `n`, while it is there, and its values.
    #[inline]
    fn row(&self, n: u64, values: &mut (impl Values + ?Sized)) -> Option<BufferedRow<()>> {
        self.rows.read(n, values).map(BufferedRow::from_words)
    }

    /// The same of the newest row, and its number.
    fn newest(&self, values: &mut (impl Values + ?Sized)) -> Option<(u64, BufferedRow<()>)> {
        self.rows.newest(values).map(|(n, words)| (n, BufferedRow::from_words(words)))
    }

    /// The relation of device and host time in an epoch, while it is one of the last few that were published.
    fn clock_line(&self, epoch: u32) -> Option<ClockLine> {
        let head = self.clock.head();
        let lines = (self.clock.oldest(head)..head).rev().filter_map(|n| self.clock.read(n, &mut ()));
        lines.map(|words| ClockLine::from_words(&words)).find(|line| line.epoch == epoch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn instants_are_rounded_to_the_nearest_period(
            ticks in prop_oneof![0..10_000_u64, any::<u64>()],
            (rate_hz, tick_hz) in prop_oneof![Just((500.0, 1e9)), Just((500.0, 7000.0)), Just((7000.0, 7000.0)), Just((300.0, 1000.0))],
        ) {
            let spec = BufferSpec { rate_hz, tick_hz, ..BufferSpec::default() };
            let wanted = (ticks as f64 * rate_hz / tick_hz).round() - 1.0;
            prop_assert_eq!(f64::from(spec.missing_between(5, ticks.saturating_add(5))), wanted.clamp(0.0, f64::from(u32::MAX)));
        }
    }
}
