//! The buffer from outside, against a naive one that keeps every row in a queue and sorts.

use crate::twins::buffer::{Naive, PERIOD};
use granular_id::buffer::{
    wrench_buffer, BufferSpec, BufferedRow, Fill, Pushed, Reader, Row, WindowSpec, Writer,
};
use proptest::prelude::*;

/// 600, or as many as `GRANULAR_ID_CASES` says.
fn cases() -> u32 {
    std::env::var("GRANULAR_ID_CASES").map_or(600, |n| n.parse().unwrap())
}

#[derive(Clone, Debug)]
enum Step {
    /// A row this many ticks after the newest so far, with a value that tells it, flags, host time and perhaps a packet.
    Push {
        ahead: i64,
        value: f64,
        flags: u8,
        host_ns: u64,
        packet: Option<u64>,
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
    let packet = prop::option::of(0..4_u64);
    let push =
        (ahead(), value, flags, 0..1_u64 << 40, packet).prop_map(|(ahead, value, flags, host_ns, packet)| {
            Step::Push { ahead, value, flags, host_ns, packet }
        });
    let fill = prop_oneof![Just(Fill::None), Just(Fill::Nan), Just(Fill::Linear)];
    let window =
        (0..14_usize, fill, 0..6_u32, any::<bool>()).prop_map(|(n, fill, max_gap, allow_saturated)| {
            Step::Window(WindowSpec { n, fill, max_gap, allow_saturated })
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
    fn new(capacity: usize, reorder_depth: usize) -> Self {
        let spec = BufferSpec {
            rate_hz: 500.0,
            seconds: capacity as f64 / 500.0,
            tick_hz: 500.0 * PERIOD as f64,
            reorder_depth,
        };
        let (writer, reader) = wrench_buffer(spec).unwrap();
        assert_eq!(reader.capacity(), capacity);
        let naive = Naive::new(capacity, reorder_depth);
        Self { writer, readers: vec![reader.clone(), reader], naive, places: vec![0, 0], newest: 10_000 }
    }

    fn run(&mut self, step: &Step) -> Result<(), TestCaseError> {
        match *step {
            Step::Push { ahead, value, flags, host_ns, packet } => {
                let ticks = self.newest.saturating_add_signed(ahead);
                let wrench = std::array::from_fn(|axis| value * (axis as f64 + 1.0));
                let row = Row { ticks, host_ns, wrench, flags };
                let pushed = match packet {
                    Some(packet) => self.writer.push_packet(&row, packet),
                    None => self.writer.push(&row),
                };
                prop_assert_eq!(pushed, self.naive.push(row, packet));
                if matches!(pushed, Pushed::Written | Pushed::Held) {
                    self.newest = self.writer.newest_ticks().unwrap();
                }
            }
            Step::Read { reader, max_rows } => {
                let mut rows = vec![BufferedRow::EMPTY; max_rows];
                let before = self.readers[reader].n_ahead();
                let taken = self.readers[reader].read(&mut rows);
                let (wanted, missed, place) = self.naive.read(self.places[reader], max_rows);
                if max_rows > 0 {
                    prop_assert_eq!((&rows[..taken.n_rows], taken.missed), (&wanted[..], missed));
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
        prop_assert_eq!(self.readers[0].latest(), self.naive.rows.back().copied());
        Ok(())
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases()))]

    #[test]
    fn equals_the_naive_buffer(
        capacity in 1..14_usize,
        depth in prop_oneof![Just(0_usize), 1..5_usize],
        steps in prop::collection::vec(step(), 1..250),
    ) {
        let mut pair = Pair::new(capacity, depth);
        for step in steps {
            pair.run(&step)?;
        }
    }
}
