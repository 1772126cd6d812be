//! The ring itself: items of a few words in slots that the newest overwrite, read without locks and never torn.
//!
//! Each slot is a sequence lock made of atomics alone: the state of a slot says which item it holds and whether it is
//! complete, and a reader that finds another state after its copy than before throws the copy away. All words are
//! atomics, so an overwritten read is a stale number, never a data race (H.-J. Boehm, "Can seqlocks get along with
//! programming language memory models?", MSPC 2012).

use std::sync::atomic::Ordering::{Acquire, Relaxed, Release};

#[cfg(all(loom, test))]
use loom::{
    hint::spin_loop,
    sync::atomic::{fence, AtomicU64},
};
#[cfg(not(all(loom, test)))]
use std::{
    hint::spin_loop,
    sync::atomic::{fence, AtomicU64},
};

use crate::error::Result;
use crate::memory::reserved;

/// One item of `WORDS` words and the state that guards it.
struct Slot<const WORDS: usize> {
    /// `2 n + 1` while item `n` is being written, `2 n + 2` once it is complete, 0 before the first.
    state: AtomicU64,
    words: [AtomicU64; WORDS],
}

/// Slots beyond the capacity, an eighth of it within these bounds: the oldest item that counts is not the one that is being
/// overwritten, and a reader of it has a while, more than a second of a sensor at 7000 Hz.
const SPARE_SLOTS: (usize, usize) = if cfg!(all(loom, test)) { (1, 1) } else { (16, 1 << 13) };

/// Items numbered from 0, of which the newest `capacity` count; item `n` takes the slot of item `n - slots`.
///
/// One thread at a time may publish; any number may read.
pub(super) struct Ring<const WORDS: usize> {
    slots: Box<[Slot<WORDS>]>,
    capacity: usize,
    head: Head,
}

/// The number of items published, on a cache line of its own: readers poll it while slots are written.
#[repr(align(128))]
struct Head(AtomicU64);

impl<const WORDS: usize> Ring<WORDS> {
    pub(super) fn new(capacity: usize) -> Result<Self> {
        Self::with_spare(capacity, (capacity / 8).clamp(SPARE_SLOTS.0, SPARE_SLOTS.1))
    }

    fn with_spare(capacity: usize, spare: usize) -> Result<Self> {
        let n_slots = capacity.saturating_add(spare);
        let mut slots = reserved(n_slots)?;
        slots.resize_with(n_slots, || Slot {
            state: AtomicU64::new(0),
            words: std::array::from_fn(|_| AtomicU64::new(0)),
        });
        Ok(Self { slots: slots.into_boxed_slice(), capacity, head: Head(AtomicU64::new(0)) })
    }

    /// Items published so far: the number of the next.
    #[inline]
    pub(super) fn head(&self) -> u64 {
        self.head.0.load(Acquire)
    }

    pub(super) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Number of the oldest item that still counts when `head` have been published.
    #[inline]
    pub(super) fn oldest(&self, head: u64) -> u64 {
        head.saturating_sub(self.capacity as u64)
    }

    /// Writes the next item over the oldest.
    #[inline]
    pub(super) fn publish(&self, item: &[u64; WORDS]) {
        let n = self.head.0.load(Relaxed);
        let slot = self.slot(n);
        slot.state.store(2 * n + 1, Relaxed);
        // No word below may be seen before the state above.
        fence(Release);
        for (word, value) in slot.words.iter().zip(item) {
            word.store(*value, Relaxed);
        }
        slot.state.store(2 * n + 2, Release);
        self.head.0.store(n + 1, Release);
    }

    /// Item `n`, or `None` when it is overwritten, being overwritten or not there yet.
    #[inline]
    pub(super) fn read(&self, n: u64) -> Option<[u64; WORDS]> {
        let slot = self.slot(n);
        let complete = 2 * n + 2;
        if slot.state.load(Acquire) != complete {
            return None;
        }
        let item = std::array::from_fn(|word| slot.words[word].load(Relaxed));
        // No word above may be read after the state below.
        fence(Acquire);
        (slot.state.load(Relaxed) == complete).then_some(item)
    }

    /// The newest item and its number.
    pub(super) fn newest(&self) -> Option<(u64, [u64; WORDS])> {
        loop {
            let n = self.head().checked_sub(1)?;
            if let Some(item) = self.read(n) {
                return Some((n, item));
            }
            // Overwritten meanwhile: all slots were, and a newer item is there.
            spin_loop();
        }
    }

    #[inline]
    fn slot(&self, n: u64) -> &Slot<WORDS> {
        // Less than the number of slots.
        #[allow(clippy::cast_possible_truncation)]
        let index = (n % self.slots.len() as u64) as usize;
        &self.slots[index]
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn holds_as_many_items_as_slots() {
        let ring = Ring::<2>::with_spare(3, 2).unwrap(); // five slots: no power of two
        assert_eq!(ring.read(0), None);
        for n in 0..9 {
            assert_eq!(ring.head(), n);
            ring.publish(&[n, !n]);
        }
        assert_eq!(ring.read(3), None);
        for n in 4..9 {
            assert_eq!(ring.read(n), Some([n, !n]));
        }
        assert_eq!(ring.read(9), None);
    }

    #[test]
    fn an_item_half_written_is_not_read() {
        let ring = Ring::<1>::with_spare(1, 0).unwrap();
        ring.publish(&[7]);
        ring.slot(1).state.store(3, Relaxed);
        assert_eq!((ring.read(0), ring.read(1)), (None, None));
    }
}

/// The code above, and the readers that stand on it, under loom: `make loom`.
///
/// Loom lets every load return each value that the memory model allows it, whatever this processor would do, and runs
/// through all combinations. The writer never looks at what a reader did, so all its stores may come first: what a reader
/// sees is then a choice for each of its loads, and interleavings add nothing. That holds for rings of few slots and items
/// (loom keeps the last seven stores of an atomic), and a pause in a loop lets newer stores be seen: that readers get
/// through in bounded time is not shown.
#[cfg(all(loom, test))]
mod model {
    use std::collections::BTreeSet;
    use std::sync::{Arc, Mutex};

    use loom::model::Builder;

    use super::*;
    use crate::buffer::{wrench_buffer, BufferSpec, BufferedRow, Reader, Row, Writer};

    /// All that `read` can return while another thread runs `write`.
    fn outcomes<W, R: Send + 'static, T: Clone + Ord + Send + 'static>(
        new: impl Fn() -> (W, R) + Send + Sync + 'static,
        write: impl Fn(W) + Send + Sync + 'static,
        read: fn(R) -> T,
    ) -> Vec<T> {
        let all = Arc::new(Mutex::new(BTreeSet::new()));
        let seen = Arc::clone(&all);
        let mut builder = Builder::new();
        builder.preemption_bound = Some(0);
        builder.check(move || {
            let ((writer, reader), seen) = (new(), Arc::clone(&seen));
            let reader = loom::thread::spawn(move || {
                let outcome = read(reader);
                seen.lock().unwrap().insert(outcome);
            });
            write(writer);
            reader.join().unwrap();
        });
        let all = all.lock().unwrap();
        all.iter().cloned().collect()
    }

    /// Two words that belong together.
    fn item(n: u64) -> [u64; 2] {
        [n + 1, !n]
    }

    /// The same for a ring of so many slots, which all count, and items.
    fn of_ring<T: Clone + Ord + Send + 'static>(
        n_slots: usize,
        n_items: u64,
        read: fn(Arc<Ring<2>>) -> T,
    ) -> Vec<T> {
        let new = move || {
            let ring = Arc::new(Ring::with_spare(n_slots, 0).unwrap());
            (Arc::clone(&ring), ring)
        };
        outcomes(new, move |ring| (0..n_items).for_each(|n| ring.publish(&item(n))), read)
    }

    #[test]
    fn an_item_is_whole_or_absent() {
        let of_two = of_ring(1, 3, |ring| [0, 1].map(|n| ring.read(n)));
        let whole = [0, 1].map(|n| Some(item(n)));
        assert_eq!(of_two, [[None; 2], [None, whole[1]], [whole[0], None], whole]);
    }

    #[test]
    fn what_the_head_announces_is_there() {
        let found = of_ring(2, 2, |ring| (0..ring.head()).map(|n| ring.read(n)).collect::<Vec<_>>());
        let whole = vec![Some(item(0)), Some(item(1))];
        assert_eq!(found, [vec![], whole[..1].to_vec(), whole]);
    }

    #[test]
    fn the_newest_is_never_older_than_one_seen_before() {
        let pairs = of_ring(1, 3, |ring| [0, 1].map(|_| ring.newest()));
        let known: Vec<_> = std::iter::once(None).chain((0..3).map(|n| Some((n, item(n))))).collect();
        let wanted: Vec<_> =
            known.iter().enumerate().flat_map(|(i, a)| known[i..].iter().map(move |b| [*a, *b])).collect();
        assert_eq!(pairs, wanted);
    }

    /// A buffer of one row, with one slot to spare.
    fn buffer() -> (Writer, Reader) {
        wrench_buffer(BufferSpec { seconds: 1.0, rate_hz: 1.0, tick_hz: 1.0, reorder_depth: 0 }).unwrap()
    }

    fn row(ticks: u64, host_s: u64) -> Row {
        Row { ticks, host_ns: 1_000_000_000 * host_s, wrench: [ticks as f64; 6], flags: 0 }
    }

    #[test]
    fn every_row_is_read_whole_or_counted_as_missed() {
        let push = |mut writer: Writer| {
            for n in 0..3 {
                writer.push(&row(n, n));
            }
        };
        let reads = outcomes(buffer, push, |mut reader| {
            let mut number = 0;
            [0, 1].map(|_| {
                let mut rows = [BufferedRow::EMPTY];
                let taken = reader.read(&mut rows);
                number += taken.missed;
                for got in &rows[..taken.n_rows] {
                    assert_eq!(got.row, row(number, number));
                    number += 1;
                }
                (taken.missed, taken.n_rows)
            })
        });
        for among in [[(0, 0), (0, 0)], [(0, 1), (0, 1)], [(0, 1), (1, 1)], [(2, 1), (0, 0)]] {
            assert!(reads.contains(&among), "{reads:?}");
        }
    }

    #[test]
    fn the_newest_row_has_the_clock_of_its_epoch() {
        let push = |mut writer: Writer| {
            writer.push(&row(7, 7));
            writer.new_epoch();
            writer.push(&row(2, 5));
        };
        let ticks = outcomes(buffer, push, |reader| reader.ticks_at(9_000_000_000).map(f64::to_bits));
        assert_eq!(ticks, [None, Some(6_f64.to_bits()), Some(9_f64.to_bits())]);
    }
}
