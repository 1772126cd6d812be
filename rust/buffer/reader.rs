//! Readers, each with a place of its own, and windows: the last instants as one array, or the reason why they are none.

use std::sync::Arc;

use super::clock::ClockLine;
use super::ring::Values;
use super::{Buffer, BufferSpec, BufferedRow, Row, Stats};
use crate::error::Error;
use crate::memory::{filled, reserved};
use crate::specs::{choices, setters};
use crate::wrench::{GAP_FILLED, SATURATED};

/// What one read brought.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    /// Rows that were read. They are of one epoch, and none between them was overwritten.
    pub n_rows: usize,
    /// Rows overwritten before the first of them, exactly.
    pub missed: u64,
}

/// One reader of a buffer; a clone starts where the original is.
///
/// Reading never blocks the writer or other readers, and never allocates except for [`window`](Self::window).
#[derive(Clone)]
pub struct Reader {
    buffer: Arc<Buffer>,
    /// Number of the next row to read.
    next: u64,
    /// Values of the row that was read last.
    values: Box<[f64]>,
}

impl Reader {
    pub(super) fn new(buffer: Arc<Buffer>) -> Self {
        let values = vec![0.0; buffer.spec.n_axes].into_boxed_slice();
        Self { buffer, next: 0, values }
    }

    /// Another reader that gets the rows to come.
    #[must_use]
    pub fn from_now(&self) -> Self {
        Self { next: self.buffer.rows.head(), ..self.clone() }
    }

    /// Another reader that gets every row still there, oldest first, and then those to come.
    #[must_use]
    pub fn from_oldest(&self) -> Self {
        Self { next: self.buffer.rows.oldest(self.buffer.rows.head()), ..self.clone() }
    }

    /// Rows written and not yet read, overwritten ones included.
    #[must_use]
    pub fn n_ahead(&self) -> u64 {
        self.buffer.rows.head() - self.next
    }

    /// Reads the oldest rows not yet read, as many as there are and fit. Ends early at the border of an epoch.
    ///
    /// # Errors
    /// [`Error::Length`] where rows have another number of values than the buffer has axes.
    pub fn read<const N: usize>(&mut self, rows: &mut [BufferedRow<[f64; N]>]) -> Result<Taken, Error> {
        let n_axes = self.buffer.spec.n_axes;
        if N != n_axes {
            return Err(Error::Length { what: "wrench", expected: n_axes, got: N });
        }
        let mut places = rows.iter_mut();
        Ok(self.read_rows(places.len(), &mut [0.0; N], |row, wrench| {
            if let Some(place) = places.next() {
                *place = row.with(*wrench);
            }
        }))
    }

    /// The same for rows of any number of axes that go elsewhere, one by one.
    pub fn read_each(&mut self, max_rows: usize, mut take: impl FnMut(&BufferedRow<&[f64]>)) -> Taken {
        let mut values = std::mem::take(&mut self.values);
        let taken = self.read_rows(max_rows, &mut *values, |row, wrench| take(&row.with(wrench)));
        self.values = values;
        taken
    }

    #[inline]
    fn read_rows<V: Values + ?Sized>(
        &mut self,
        max_rows: usize,
        values: &mut V,
        mut take: impl FnMut(&BufferedRow<()>, &V),
    ) -> Taken {
        let mut taken = Taken::default();
        if max_rows == 0 {
            return taken;
        }
        let mut head = self.buffer.rows.head();
        let mut epoch = None;
        while self.next < head && taken.n_rows < max_rows {
            let oldest = self.buffer.rows.oldest(head);
            // Rows that no longer count are missed, even where their slots are still whole: what is missed must depend
            // on how far behind a reader is, not on how many slots there are to spare.
            let row = if self.next < oldest { None } else { self.buffer.row(self.next, values) };
            match row {
                Some(row) if *epoch.get_or_insert(row.epoch) == row.epoch => {
                    take(&row, values);
                    taken.n_rows += 1;
                    self.next += 1;
                }
                // Never rows from both sides of a loss, nor of two epochs: the next read goes on there.
                _ if taken.n_rows > 0 => break,
                _ => {
                    head = self.buffer.rows.head();
                    let next = self.buffer.rows.oldest(head).max(self.next + 1);
                    taken.missed += next - self.next;
                    self.next = next;
                }
            }
        }
        taken
    }

    /// The newest row.
    pub fn latest(&mut self) -> Option<BufferedRow<&[f64]>> {
        let (_, row) = self.buffer.newest(&mut *self.values)?;
        Some(row.with(&*self.values))
    }

    /// The last instants, up to the newest row, as one array: a copy.
    pub fn window(&self, spec: &WindowSpec) -> Result<Window, WindowError> {
        if spec.n > self.capacity() {
            return Err(WindowError::TooLong { n: spec.n, capacity: self.capacity() as u64 });
        }
        let (rows, values) = newest_first(&self.buffer, spec)?;
        assemble(&rows, &values, spec, self.buffer.spec.n_axes)
    }

    /// Counts since the buffer was made.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.buffer.counters.load()
    }

    /// What the buffer was made for.
    #[must_use]
    pub fn spec(&self) -> &BufferSpec {
        &self.buffer.spec
    }

    /// Rows the buffer holds.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.buffer.rows.capacity()
    }

    /// How long before `now` the newest row would have arrived without any delay, in nanoseconds; `None` without rows.
    #[must_use]
    pub fn lag_ns(&self, now: u64) -> Option<f64> {
        let (line, newest) = self.newest_on_line()?;
        Some(line.lag_ns(newest.row.ticks, now))
    }

    /// Host time at which a row with these ticks would have arrived without any delay, in the newest epoch.
    #[must_use]
    pub fn host_ns_at(&self, ticks: u64) -> Option<f64> {
        Some(self.newest_on_line()?.0.host_ns(ticks))
    }

    /// Device time in ticks at a moment of host time, in the newest epoch; `None` too where all rows came at one moment.
    #[must_use]
    pub fn ticks_at(&self, host_ns: u64) -> Option<f64> {
        Some(self.newest_on_line()?.0.ticks(host_ns)).filter(|ticks| ticks.is_finite())
    }

    /// The newest row and the clock of its epoch.
    fn newest_on_line(&self) -> Option<(ClockLine, BufferedRow<()>)> {
        loop {
            let (_, newest) = self.buffer.newest(&mut ())?;
            // The writer publishes a line before the first row on it, so one is there unless it was replaced meanwhile.
            if let Some(line) = self.buffer.clock_line(newest.epoch) {
                return Some((line, newest));
            }
            std::hint::spin_loop();
        }
    }
}

/// What stands for an instant without a row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Fill {
    /// Nothing: the window has as many rows as were measured, and its mask shows where they belong.
    #[default]
    None,
    /// NaN on every axis.
    Nan,
    /// A straight line between the rows on both sides, with the flag [`GAP_FILLED`].
    Linear,
}

choices! { Fill: "none" None, "nan" Nan, "linear" Linear, }

/// Which window is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct WindowSpec {
    /// Instants, up to the newest row, with or without a row.
    pub n: usize,
    /// What stands for an instant without a row.
    pub fill: Fill,
    /// Longest gap, in instants, that the window may touch.
    pub max_gap: u32,
    /// Whether rows at the end of the sensor's range are taken.
    pub allow_saturated: bool,
}

impl WindowSpec {
    /// A window without gaps and saturation.
    #[must_use]
    pub fn whole(n: usize) -> Self {
        Self { n, fill: Fill::None, max_gap: 0, allow_saturated: false }
    }
}

setters! {
    WindowSpec:
    with_fill fill Fill,
    with_max_gap max_gap u32,
    with_allow_saturated allow_saturated bool,
}

/// Rows of a window, oldest first: a copy that later rows do not change.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Window {
    /// One entry per instant: whether a row was measured there.
    pub mask: Vec<bool>,
    /// Device time; interpolated where a row is filled in.
    pub ticks: Vec<u64>,
    /// Host time of arrival; interpolated where a row is filled in.
    pub host_ns: Vec<u64>,
    /// Values of the axes, row by row.
    pub wrench: Vec<f64>,
    /// Flags of the samples.
    pub flags: Vec<u8>,
}

/// Why there is no such window.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WindowError {
    /// More instants than the buffer has room for.
    #[error("n must be at most the capacity of the buffer, {capacity}, got {n}")]
    TooLong {
        /// Instants requested.
        n: usize,
        /// Rows the buffer holds.
        capacity: u64,
    },
    /// Not enough rows yet, or no longer.
    #[error("a window of n = {n} needs as many instants, got {have} in the buffer")]
    TooFew {
        /// Instants requested.
        n: usize,
        /// Instants there are.
        have: u64,
    },
    /// A gap that is too long.
    #[error("a window may have gaps of at most max_gap = {max_gap} instants, got one of {missing} that ended {ago} instants before the newest row")]
    Gap {
        /// Its length in instants.
        missing: u32,
        /// The longest allowed.
        max_gap: u32,
        /// Instants from its end to the newest row.
        ago: u64,
    },
    /// The device started again within the window.
    #[error("a window must lie in one epoch: a window of n = {n} was requested, and the present epoch has {have} instants")]
    EpochBorder {
        /// Instants requested.
        n: usize,
        /// Instants since the border.
        have: u64,
    },
    /// A row at the end of the sensor's range.
    #[error("a window must be free of saturation unless allow_saturated is set: the row {ago} instants before the newest is saturated")]
    Saturated {
        /// Instants from the row to the newest.
        ago: u64,
    },
    /// No memory for so many rows.
    #[error(transparent)]
    Memory(#[from] Error),
}

/// Rows from the newest back to the first of the window, and their values; if that begins inside a gap, the row before the
/// gap too.
fn newest_first(buffer: &Buffer, spec: &WindowSpec) -> Result<(Vec<BufferedRow<()>>, Vec<f64>), WindowError> {
    let (n, n_axes) = (spec.n, buffer.spec.n_axes);
    let wanted = n as u64;
    let mut rows: Vec<BufferedRow<()>> = reserved(n.saturating_add(1))?;
    let mut values = filled(0.0, n.saturating_add(1).saturating_mul(n_axes))?;
    let mut have = 0_u64;
    if wanted == 0 {
        return Ok((rows, values));
    }
    let too_few = |have| WindowError::TooFew { n, have };
    let (mut number, mut row) = buffer.newest(&mut values[..n_axes]).ok_or(too_few(0))?;
    let oldest = buffer.rows.oldest(number + 1);
    loop {
        if rows.last().is_some_and(|later| later.epoch != row.epoch) {
            return Err(WindowError::EpochBorder { n, have });
        }
        let begins_in_gap = have >= wanted;
        let counts = !begins_in_gap || spec.fill == Fill::Linear;
        if counts && row.row.flags & SATURATED != 0 && !spec.allow_saturated {
            return Err(WindowError::Saturated { ago: have });
        }
        rows.push(row);
        if begins_in_gap {
            return Ok((rows, values));
        }
        have += 1;
        if have == wanted {
            return Ok((rows, values));
        }
        let missing = row.missing_before;
        if missing > spec.max_gap {
            return Err(WindowError::Gap { missing, max_gap: spec.max_gap, ago: have - 1 });
        }
        let measured = have;
        have += u64::from(missing);
        number = number.checked_sub(1).filter(|number| *number >= oldest).ok_or(too_few(measured))?;
        row = buffer.row(number, &mut values[rows.len() * n_axes..][..n_axes]).ok_or(too_few(measured))?;
    }
}

/// Puts rows, newest first, and what stands for the missing ones into arrays, oldest first.
fn assemble(
    newest_first: &[BufferedRow<()>],
    values: &[f64],
    spec: &WindowSpec,
    n_axes: usize,
) -> Result<Window, WindowError> {
    let mut window = Window::with_room(spec.n, n_axes)?;
    let row = |place: usize| newest_first[place].with(&values[place * n_axes..][..n_axes]);
    let spans: u64 = newest_first.iter().map(|row| 1 + u64::from(row.missing_before)).sum();
    let Some(last) = newest_first.len().checked_sub(1) else { return Ok(window) };
    let oldest = row(last);
    // What is missing before the oldest row lies before the window; the last gap may begin before it as well.
    let spans = spans - u64::from(oldest.missing_before);
    let begins_in_gap = spans > spec.n as u64;
    if !begins_in_gap {
        window.push(&oldest.row);
    }
    let mut outside = spans - spec.n as u64;
    for place in (0..last).rev() {
        let (later, earlier) = (row(place), row(place + 1));
        // The row before the gap is outside too.
        let first = if outside > 0 { outside } else { 1 };
        outside = 0;
        for place in first..=u64::from(later.missing_before) {
            window.push_missing(&earlier.row, &later, place, spec.fill);
        }
        window.push(&later.row);
    }
    Ok(window)
}

impl Window {
    /// An empty window with memory for `n` instants.
    fn with_room(n: usize, n_axes: usize) -> Result<Self, Error> {
        Ok(Self {
            mask: reserved(n)?,
            ticks: reserved(n)?,
            host_ns: reserved(n)?,
            wrench: reserved(n.saturating_mul(n_axes))?,
            flags: reserved(n)?,
        })
    }

    fn push(&mut self, row: &Row<&[f64]>) {
        self.mask.push(true);
        self.ticks.push(row.ticks);
        self.host_ns.push(row.host_ns);
        self.wrench.extend_from_slice(row.wrench);
        self.flags.push(row.flags);
    }

    /// The instant `place`, from 1, of the gap between two rows.
    fn push_missing(&mut self, earlier: &Row<&[f64]>, later: &BufferedRow<&[f64]>, place: u64, fill: Fill) {
        self.mask.push(false);
        if fill == Fill::None {
            return;
        }
        let steps = u64::from(later.missing_before) + 1;
        let later = &later.row;
        let (part, is_linear) = (place as f64 / steps as f64, fill == Fill::Linear);
        let value = |(a, b): (&f64, &f64)| if is_linear { a + (b - a) * part } else { f64::NAN };
        self.ticks.push(between(earlier.ticks, later.ticks, place, steps));
        self.host_ns.push(between(earlier.host_ns, later.host_ns, place, steps));
        self.wrench.extend(earlier.wrench.iter().zip(later.wrench).map(value));
        self.flags.push(if is_linear { GAP_FILLED } else { 0 });
    }
}

/// The whole number `place / steps` of the way from `a` to `b`, without overflow.
fn between(a: u64, b: u64, place: u64, steps: u64) -> u64 {
    let way = u128::from(b.abs_diff(a)) * u128::from(place) / u128::from(steps.max(1));
    // At most the way between two numbers of 64 bits.
    let way = u64::try_from(way).unwrap_or(u64::MAX);
    if b >= a {
        a.saturating_add(way)
    } else {
        a.saturating_sub(way)
    }
}
