//! The buffer from outside, against a naive one that keeps every row in a queue and sorts.

use std::collections::VecDeque;

use granular_id::buffer::{
    wrench_buffer, BufferSpec, BufferedRow, Fill, Pushed, Reader, Row, Stats, Window, WindowError,
    WindowSpec, Writer,
};
use granular_id::wrench::{BAD_STATUS, GAP_FILLED, SATURATED};
use proptest::prelude::*;

/// 600, or as many as `GRANULAR_ID_CASES` says.
fn cases() -> u32 {
    std::env::var("GRANULAR_ID_CASES").map_or(600, |n| n.parse().unwrap())
}

#[derive(Clone, Debug)]
enum Step {
    /// A row this many ticks after the newest so far, with a value that tells it, flags and host time.
    Push {
        ahead: i64,
        value: f64,
        flags: u8,
        host_ns: u64,
    },
    Read {
        reader: usize,
        max_rows: usize,
    },
    Window(WindowSpec),
    NewEpoch,
    Flush,
    Join {
        reader: usize,
        from_oldest: bool,
    },
}

fn ahead() -> impl Strategy<Value = i64> {
    prop_oneof![
        20 => Just(10_i64),
        4 => 1..60_i64,
        4 => -80..1_i64,
        2 => prop_oneof![Just(20_i64), Just(-10), Just(0), Just(14), Just(15), Just(25)],
        1 => prop_oneof![Just(-5000_i64), Just(-5001), Just(-7000), Just(3_000_000), Just(60_000_000_000)],
    ]
}

fn step() -> impl Strategy<Value = Step> {
    let value = prop_oneof![40 => -1e3..1e3, 1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY)]];
    let flags = prop_oneof![12 => Just(0_u8), 1 => 0..16_u8];
    let push = (ahead(), value, flags, 0..1_u64 << 40)
        .prop_map(|(ahead, value, flags, host_ns)| Step::Push { ahead, value, flags, host_ns });
    let fill = prop_oneof![Just(Fill::None), Just(Fill::Nan), Just(Fill::Linear)];
    let window =
        (0..14_usize, fill, 0..6_u32, any::<bool>()).prop_map(|(n, fill, max_gap, allow_saturated)| {
            Step::Window(
                WindowSpec::whole(n)
                    .with_fill(fill)
                    .with_max_gap(max_gap)
                    .with_allow_saturated(allow_saturated),
            )
        });
    prop_oneof![
        30 => push,
        6 => (0..2_usize, 0..9_usize).prop_map(|(reader, max_rows)| Step::Read { reader, max_rows }),
        6 => window,
        1 => Just(Step::NewEpoch),
        1 => Just(Step::Flush),
        1 => (0..2_usize, any::<bool>()).prop_map(|(reader, from_oldest)| Step::Join { reader, from_oldest }),
    ]
}

/// The buffer and the naive one, side by side.
struct Pair {
    writer: Writer,
    readers: Vec<Reader>,
    naive: Naive,
    places: Vec<u64>,
    /// Device time that steps are relative to.
    newest: u64,
}

impl Pair {
    fn new(capacity: usize, reorder_depth: usize, n_axes: usize) -> Self {
        let spec = BufferSpec::default()
            .with_rate_hz(500.0)
            .with_seconds(capacity as f64 / 500.0)
            .with_tick_hz(500.0 * PERIOD as f64)
            .with_reorder_depth(reorder_depth)
            .with_n_axes(n_axes);
        let (writer, reader) = wrench_buffer(spec).unwrap();
        assert_eq!(reader.capacity(), capacity);
        let naive = Naive::new(capacity, reorder_depth);
        Self { writer, readers: vec![reader.clone(), reader], naive, places: vec![0, 0], newest: 10_000 }
    }

    fn run(&mut self, step: &Step) -> Result<(), TestCaseError> {
        match *step {
            Step::Push { ahead, value, flags, host_ns } => {
                let ticks = self.newest.saturating_add_signed(ahead);
                let n_axes = self.writer.spec().n_axes;
                let wrench: Vec<f64> = (0..n_axes).map(|axis| value * (axis as f64 + 1.0)).collect();
                let row = Row { ticks, host_ns, wrench, flags };
                let pushed = self.writer.push(&row);
                prop_assert_eq!(pushed, self.naive.push(row));
                if matches!(pushed, Pushed::Written | Pushed::Held) {
                    self.newest = self.writer.newest_ticks().unwrap();
                }
            }
            Step::Read { reader, max_rows } => {
                let mut rows = Vec::new();
                let before = self.readers[reader].n_ahead();
                let taken = self.readers[reader].read_each(max_rows, |row| rows.push(owned(row)));
                let (wanted, missed, place) = self.naive.read(self.places[reader], max_rows);
                if max_rows > 0 {
                    prop_assert_eq!((&rows, taken.missed), (&wanted, missed));
                    self.places[reader] = place;
                } else {
                    prop_assert_eq!((taken.n_rows, taken.missed), (0, 0));
                }
                let passed = taken.n_rows as u64 + taken.missed;
                prop_assert_eq!(self.readers[reader].n_ahead() + passed, before);
            }
            Step::Window(spec) => {
                let [got, wanted] =
                    [self.readers[0].window(&spec), self.naive.window(&spec)].map(|w| format!("{w:?}"));
                prop_assert_eq!(got, wanted, "{:?}", spec); // as text: NaN is equal to itself there
            }
            Step::NewEpoch => {
                self.writer.new_epoch();
                self.naive.new_epoch();
            }
            Step::Flush => {
                self.writer.flush();
                self.naive.flush();
            }
            Step::Join { reader, from_oldest } => {
                let end = self.naive.n_overwritten + self.naive.rows.len() as u64;
                (self.readers[reader], self.places[reader]) = if from_oldest {
                    (self.readers[1].from_oldest(), self.naive.n_overwritten)
                } else {
                    (self.readers[1].from_now(), end)
                };
            }
        }
        prop_assert_eq!(self.readers[0].stats(), self.naive.stats);
        let latest = self.readers[0].latest().map(|row| owned(&row));
        prop_assert_eq!(latest.as_ref(), self.naive.rows.back());
        Ok(())
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases()))]

    #[test]
    fn equals_the_naive_buffer(
        capacity in 1..14_usize,
        depth in prop_oneof![Just(0_usize), 1..5_usize],
        n_axes in 1..9_usize,
        steps in prop::collection::vec(step(), 1..250),
    ) {
        let mut pair = Pair::new(capacity, depth, n_axes);
        for step in steps {
            pair.run(&step)?;
        }
    }
}

fn owned(row: &BufferedRow<&[f64]>) -> BufferedRow<Vec<f64>> {
    row.with(row.row.wrench.to_vec())
}

/// Ticks per period: half a period is a whole number of them.
const PERIOD: u64 = 10;

/// What the buffer promises, done the slow way: it keeps rows in a queue, sorts those that wait and searches the rest.
struct Naive {
    capacity: usize,
    depth: usize,
    /// The newest rows up to the capacity.
    rows: VecDeque<BufferedRow<Vec<f64>>>,
    n_overwritten: u64,
    held: Vec<Row<Vec<f64>>>,
    epoch: u32,
    late_in_a_row: u32,
    stats: Stats,
}

fn missing_between(earlier: u64, later: u64) -> u32 {
    let periods = (later - earlier + PERIOD / 2) / PERIOD;
    u32::try_from(periods.saturating_sub(1)).unwrap_or(u32::MAX)
}

impl Naive {
    fn new(capacity: usize, depth: usize) -> Self {
        Self {
            capacity,
            depth,
            rows: VecDeque::new(),
            n_overwritten: 0,
            held: Vec::new(),
            epoch: 0,
            late_in_a_row: 0,
            stats: Stats::default(),
        }
    }

    /// Device time of the newest row of this epoch.
    fn newest(&self) -> Option<u64> {
        self.rows.back().filter(|row| row.epoch == self.epoch).map(|row| row.row.ticks)
    }

    fn push(&mut self, row: Row<Vec<f64>>) -> Pushed {
        if row.wrench.iter().any(|value| !value.is_finite()) {
            self.stats.non_finite += 1;
            return Pushed::NonFinite;
        }
        let Some(newest) = self.newest() else {
            self.write(row);
            return Pushed::Written;
        };
        if row.ticks > newest {
            self.late_in_a_row = 0;
        }
        if newest > row.ticks + 500 * PERIOD {
            return self.restart(row);
        }
        let here = self.rows.iter().filter(|row| row.epoch == self.epoch).map(|row| &row.row);
        if here.chain(&self.held).any(|had| had.ticks == row.ticks) {
            self.stats.duplicates += 1;
            return Pushed::Duplicate;
        }
        if row.ticks < newest {
            self.late_in_a_row += 1;
            if self.late_in_a_row == 8 {
                return self.restart(row);
            }
            self.stats.late += 1;
            return Pushed::Late;
        }
        self.stats.reordered += u64::from(self.held.iter().any(|had| had.ticks > row.ticks));
        let ticks = row.ticks;
        self.held.push(row);
        self.held.sort_by_key(|row| row.ticks);
        while let (Some(first), Some(newest)) = (self.held.first(), self.newest()) {
            if missing_between(newest, first.ticks) > 0 && self.held.len() <= self.depth {
                break;
            }
            let first = self.held.remove(0);
            self.write(first);
        }
        self.stats.held = self.held.len() as u64;
        if self.newest().is_some_and(|newest| newest >= ticks) {
            Pushed::Written
        } else {
            Pushed::Held
        }
    }

    fn restart(&mut self, row: Row<Vec<f64>>) -> Pushed {
        self.new_epoch();
        self.write(row);
        Pushed::Written
    }

    fn write(&mut self, row: Row<Vec<f64>>) {
        let missing_before = self.newest().map_or(0, |newest| missing_between(newest, row.ticks));
        self.stats.written += 1;
        self.stats.gaps += u64::from(missing_before > 0);
        self.stats.missing += u64::from(missing_before);
        self.stats.saturated += u64::from(row.flags & SATURATED != 0);
        self.stats.bad_status += u64::from(row.flags & BAD_STATUS != 0);
        self.rows.push_back(BufferedRow { row, missing_before, epoch: self.epoch });
        if self.rows.len() > self.capacity {
            self.rows.pop_front();
            self.n_overwritten += 1;
        }
    }

    fn flush(&mut self) {
        for row in std::mem::take(&mut self.held) {
            self.write(row);
        }
        self.stats.held = 0;
    }

    fn new_epoch(&mut self) {
        self.flush();
        if self.newest().is_some() {
            self.epoch += 1;
            self.stats.epochs += 1;
        }
        self.late_in_a_row = 0;
    }

    /// Rows and missed from a place on, and the next place.
    fn read(&self, place: u64, max_rows: usize) -> (Vec<BufferedRow<Vec<f64>>>, u64, u64) {
        let missed = self.n_overwritten.saturating_sub(place);
        let mut place = place + missed;
        let mut rows: Vec<BufferedRow<Vec<f64>>> = Vec::new();
        while let Some(row) = usize::try_from(place - self.n_overwritten).ok().and_then(|i| self.rows.get(i))
        {
            if rows.len() == max_rows || rows.last().is_some_and(|last| last.epoch != row.epoch) {
                break;
            }
            rows.push(row.clone());
            place += 1;
        }
        (rows, missed, place)
    }

    /// The window, or the obstacle nearest to the newest row.
    fn window(&self, spec: &WindowSpec) -> Result<Window, WindowError> {
        let n = spec.n;
        if n > self.capacity {
            return Err(WindowError::TooLong { n, capacity: self.capacity as u64 });
        }
        if n > 0 && self.rows.is_empty() {
            return Err(WindowError::TooFew { n, have: 0 });
        }
        let tail: Vec<_> = self
            .rows
            .iter()
            .rev()
            .take_while(|row| Some(row.epoch) == self.rows.back().map(|r| r.epoch))
            .collect();
        let mut instants: Vec<(usize, u64)> = Vec::new(); // newest first: row of the tail, place in the gap before it
        for (i, row) in tail.iter().enumerate() {
            instants.push((i, 0));
            let here = instants.len() as u64 - 1;
            if here < n as u64 && row.row.flags & SATURATED != 0 && !spec.allow_saturated {
                return Err(WindowError::Saturated { ago: here });
            }
            if instants.len() >= n {
                break;
            }
            if row.missing_before > spec.max_gap {
                return Err(WindowError::Gap {
                    missing: row.missing_before,
                    max_gap: spec.max_gap,
                    ago: here,
                });
            }
            if i + 1 == tail.len() {
                let have = instants.len() as u64;
                return Err(if tail.len() < self.rows.len() {
                    WindowError::EpochBorder { n, have }
                } else {
                    WindowError::TooFew { n, have }
                });
            }
            for place in (1..=u64::from(row.missing_before)).rev() {
                instants.push((i, place));
            }
            if instants.len() >= n {
                if spec.fill == Fill::Linear
                    && tail[i + 1].row.flags & SATURATED != 0
                    && !spec.allow_saturated
                {
                    return Err(WindowError::Saturated { ago: instants.len() as u64 });
                }
                break;
            }
        }
        instants.truncate(n);
        let mut window = Window::default();
        for (i, place) in instants.into_iter().rev() {
            window.mask.push(place == 0);
            let row = if place == 0 {
                tail[i].row.clone()
            } else if spec.fill == Fill::None {
                continue;
            } else {
                filled(&tail[i + 1].row, tail[i], place, spec.fill)
            };
            window.ticks.push(row.ticks);
            window.host_ns.push(row.host_ns);
            window.wrench.extend(row.wrench);
            window.flags.push(row.flags);
        }
        Ok(window)
    }
}

fn filled(earlier: &Row<Vec<f64>>, later: &BufferedRow<Vec<f64>>, place: u64, fill: Fill) -> Row<Vec<f64>> {
    let steps = u64::from(later.missing_before) + 1;
    let later = &later.row;
    let whole = |a: u64, b: u64| {
        let way = (i128::from(b) - i128::from(a)) * i128::from(place) / i128::from(steps);
        u64::try_from(i128::from(a) + way).unwrap()
    };
    let value = |axis: usize| match fill {
        Fill::Linear => {
            earlier.wrench[axis] + (later.wrench[axis] - earlier.wrench[axis]) * (place as f64 / steps as f64)
        }
        _ => f64::NAN,
    };
    Row {
        ticks: whole(earlier.ticks, later.ticks),
        host_ns: whole(earlier.host_ns, later.host_ns),
        wrench: (0..later.wrench.len()).map(value).collect(),
        flags: if fill == Fill::Linear { GAP_FILLED } else { 0 },
    }
}
