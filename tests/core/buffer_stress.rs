//! One writer and two readers, one of which sleeps: nothing torn, nothing lost uncounted.
//!
//! `GRANULAR_ID_RING_ITEMS=1000000000 cargo test --release --test core buffer_stress -- --nocapture` is the long run.

use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::{Acquire, Release};
use std::thread;
use std::time::Duration;

use granular_id::buffer::{wrench_buffer, BufferSpec, BufferedRow, Reader, Row, WindowSpec};

/// Rows that the buffer holds: so few that the writer laps the readers all the time.
const CAPACITY: usize = 64;

fn items() -> u64 {
    std::env::var("GRANULAR_ID_RING_ITEMS").map_or(3_000_000, |n| n.parse().unwrap())
}

/// A row in which every word tells its number.
fn row(n: u64) -> Row {
    let word = |axis: u64| (n.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ axis).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    Row {
        ticks: n,
        // Two clocks that agree, but for delays of up to a microsecond.
        host_ns: 2_000_000 * n + word(7) % 1000,
        // The exponent of a number from 1 to 2: any bits below are finite.
        wrench: std::array::from_fn(|axis| f64::from_bits(word(axis as u64) >> 12 | 0x3ff0 << 48)),
        flags: n.to_le_bytes()[0] & 15,
    }
}

#[derive(Default, Debug)]
struct Account {
    delivered: u64,
    missed: u64,
    torn: u64,
    out_of_place: u64,
    reads_with_loss: u64,
}

impl Account {
    /// Reads whatever is there and checks every row against its number.
    fn read(&mut self, reader: &mut Reader, rows: &mut [BufferedRow]) -> usize {
        let taken = reader.read(rows).unwrap();
        self.missed += taken.missed;
        self.reads_with_loss += u64::from(taken.missed > 0);
        for got in &rows[..taken.n_rows] {
            // Rows are numbered without holes: every number follows from what came and what was missed before.
            let number = self.delivered + self.missed;
            self.torn += u64::from(got.row != row(got.row.ticks) || got.epoch != 0);
            self.out_of_place += u64::from(got.row.ticks != number || got.missing_before != 0);
            self.delivered += 1;
        }
        taken.n_rows
    }
}

#[test]
fn two_readers_lose_nothing_uncounted() {
    let n_items = items();
    let spec = BufferSpec::default().with_seconds(CAPACITY as f64 / 500.0).with_tick_hz(500.0);
    let (mut writer, reader) = wrench_buffer(spec).unwrap();
    let over = AtomicBool::new(false);
    let run = |naps: bool| {
        let mut reader = reader.clone();
        let over = &over;
        move || {
            let mut account = Account::default();
            let mut rows = [BufferedRow::EMPTY; 48];
            let mut windows = 0_u64;
            for turn in 0_u64.. {
                // Looked at before the read: rows written until then are read below.
                let last = over.load(Acquire);
                let n_rows = account.read(&mut reader, &mut rows);
                if let Ok(window) = reader.window(&WindowSpec::whole(8).with_allow_saturated(true)) {
                    let whole = window.ticks.windows(2).all(|pair| pair[1] == pair[0] + 1);
                    let same = window.ticks.iter().flat_map(|ticks| row(*ticks).wrench).eq(window.wrench);
                    account.torn += u64::from(!whole || !same);
                    windows += 1;
                }
                if last && n_rows == 0 {
                    break;
                }
                if naps && turn % 64 == 0 {
                    thread::sleep(Duration::from_micros(200));
                }
            }
            (account, windows)
        }
    };
    let accounts = thread::scope(|scope| {
        let readers = [scope.spawn(run(false)), scope.spawn(run(true))];
        for n in 0..n_items {
            writer.push(&row(n));
        }
        over.store(true, Release);
        readers.map(|reader| reader.join().unwrap())
    });
    for (name, (account, windows)) in ["awake", "asleep at times"].iter().zip(&accounts) {
        println!("{n_items} items, reader {name}: {account:?}, {windows} whole windows");
        assert_eq!((account.torn, account.out_of_place), (0, 0), "{name}");
        assert_eq!(account.delivered + account.missed, n_items, "{name}");
        assert!(account.delivered > 0 && *windows > 0, "{name}");
    }
    assert!(accounts[1].0.missed > 0, "a reader asleep must have been lapped for this to show anything");
    assert_eq!(reader.stats().written, n_items);
}
