//! The ring itself: items of some words in slots that the newest overwrite, read without locks and never torn.
//!
//! Each slot is a sequence lock made of atomics alone: the state of a slot names the item it holds and whether it is
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

/// Slots beyond the capacity, an eighth of it within these bounds: the oldest item that counts is not the one that is being
/// overwritten, and a reader of it has a while, more than a second of a sensor at 7000 Hz.
const SPARE_SLOTS: (usize, usize) = if cfg!(all(loom, test)) { (1, 1) } else { (16, 1 << 13) };

/// Items numbered from 0, of which the newest `capacity` count; item `n` takes the slot of item `n - slots`.
///
/// An item is `FIXED` words and as many values as the ring is made for. One thread at a time may publish; any number may
/// read.
pub(super) struct Ring<const FIXED: usize> {
    /// Slot after slot: its state, then the words of its item, then the values. The state is `2 n + 1` while item `n` is
    /// being written, `2 n + 2` once it is complete, 0 before the first.
    words: Box<[AtomicU64]>,
    slot_len: usize,
    n_slots: u64,
    capacity: usize,
    head: Head,
}

/// Where values of an item are read to; no values to `()`.
pub(super) trait Values {
    /// Takes what the words of a slot hold at this moment.
    fn load(&mut self, words: &[AtomicU64]);
}

impl Values for () {
    fn load(&mut self, _: &[AtomicU64]) {}
}

impl Values for [f64] {
    #[inline]
    fn load(&mut self, words: &[AtomicU64]) {
        for (value, word) in self.iter_mut().zip(words) {
            *value = f64::from_bits(word.load(Relaxed));
        }
    }
}

/// Without a loop and by way of registers: twice as fast as a slice.
impl<const N: usize> Values for [f64; N] {
    #[inline]
    fn load(&mut self, words: &[AtomicU64]) {
        if let Some(words) = words.first_chunk::<N>() {
            *self = words.each_ref().map(|word| f64::from_bits(word.load(Relaxed)));
        }
    }
}

/// The number of items published, on a cache line of its own: readers poll it while slots are written.
#[repr(align(128))]
struct Head(AtomicU64);

impl<const FIXED: usize> Ring<FIXED> {
    pub(super) fn new(capacity: usize, n_values: usize) -> Result<Self> {
        Self::with_spare(capacity, (capacity / 8).clamp(SPARE_SLOTS.0, SPARE_SLOTS.1), n_values)
    }

    fn with_spare(capacity: usize, spare: usize, n_values: usize) -> Result<Self> {
        let (n_slots, slot_len) = (capacity.saturating_add(spare), 1 + FIXED + n_values);
        let n_words = n_slots.saturating_mul(slot_len);
        let mut words = reserved(n_words)?;
        words.resize_with(n_words, || AtomicU64::new(0));
        let (words, n_slots, head) = (words.into_boxed_slice(), n_slots as u64, Head(AtomicU64::new(0)));
        Ok(Self { words, slot_len, n_slots, capacity, head })
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
    pub(super) fn publish(&self, fixed: &[u64; FIXED], values: &[f64]) {
        let n = self.head.0.load(Relaxed);
        let Some((state, fixed_words, value_words)) = self.slot(n) else { return };
        state.store(2 * n + 1, Relaxed);
        // No word below may be seen before the state above.
        fence(Release);
        for (word, value) in fixed_words.iter().zip(fixed) {
            word.store(*value, Relaxed);
        }
        // As long as the values: an array of them is stored without a loop.
        for (word, value) in value_words[..values.len()].iter().zip(values) {
            word.store(value.to_bits(), Relaxed);
        }
        state.store(2 * n + 2, Release);
        self.head.0.store(n + 1, Release);
    }

    /// Item `n`, or `None` when it is overwritten, being overwritten or not there yet: its words, and its
    /// values, which are to be used only where it is there.
    #[inline]
    pub(super) fn read(&self, n: u64, values: &mut (impl Values + ?Sized)) -> Option<[u64; FIXED]> {
        let (state, fixed_words, value_words) = self.slot(n)?;
        let complete = 2 * n + 2;
        if state.load(Acquire) != complete {
            return None;
        }
        let fixed = fixed_words.each_ref().map(|word| word.load(Relaxed));
        values.load(value_words);
        // No word above may be read after the state below.
        fence(Acquire);
        (state.load(Relaxed) == complete).then_some(fixed)
    }

    /// The newest item, as [`read`](Self::read) gives it, and its number.
    pub(super) fn newest(&self, values: &mut (impl Values + ?Sized)) -> Option<(u64, [u64; FIXED])> {
        loop {
            let n = self.head().checked_sub(1)?;
            if let Some(fixed) = self.read(n, values) {
                return Some((n, fixed));
            }
            // Overwritten meanwhile: all slots were, and a newer item is there.
            spin_loop();
        }
    }

    #[inline]
    fn slot(&self, n: u64) -> Option<(&AtomicU64, &[AtomicU64; FIXED], &[AtomicU64])> {
        // Less than the number of slots.
        #[allow(clippy::cast_possible_truncation)]
        let index = (n % self.n_slots) as usize;
        let slot = &self.words[index * self.slot_len..][..self.slot_len];
        let (state, words) = slot.split_first()?;
        let (fixed, values) = words.split_first_chunk()?;
        Some((state, fixed, values))
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn holds_as_many_items_as_slots() {
        for n_values in [0, 1, 7] {
            let ring = Ring::<2>::with_spare(3, 2, n_values).unwrap(); // five slots: no power of two
            let read = |n| {
                let mut values = vec![0.0; n_values];
                ring.read(n, values.as_mut_slice()).map(|fixed| (fixed, values))
            };
            let item = |n: u64| ([n, !n], vec![n as f64; n_values]);
            assert_eq!(read(0), None);
            for n in 0..9 {
                assert_eq!(ring.head(), n);
                let (fixed, values) = item(n);
                ring.publish(&fixed, &values);
            }
            assert_eq!(read(3), None);
            for n in 4..9 {
                assert_eq!(read(n), Some(item(n)));
            }
            assert_eq!(read(9), None);
            assert_eq!(ring.read(8, &mut ()), Some([8, !8]));
        }
    }

    #[test]
    fn an_item_half_written_is_not_read() {
        let ring = Ring::<1>::with_spare(1, 0, 1).unwrap();
        ring.publish(&[7], &[7.0]);
        ring.slot(1).unwrap().0.store(3, Relaxed);
        assert_eq!([0, 1].map(|n| ring.read(n, &mut [0.0])), [None, None]);
    }
}

/// The code above, and the readers that stand on it, under loom: `make nightly CHECK=ring`.
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

    /// A word and the bits of a value that belong together.
    fn item(n: u64) -> [u64; 2] {
        [n + 1, (n as f64).to_bits()]
    }

    fn read(ring: &Ring<1>, n: u64) -> Option<[u64; 2]> {
        let mut value = [0.0];
        ring.read(n, &mut value).map(|[word]| [word, value[0].to_bits()])
    }

    fn newest(ring: &Ring<1>) -> Option<(u64, [u64; 2])> {
        let mut value = [0.0];
        ring.newest(&mut value).map(|(n, [word])| (n, [word, value[0].to_bits()]))
    }

    /// The same for a ring of so many slots, which all count, and items.
    fn of_ring<T: Clone + Ord + Send + 'static>(
        n_slots: usize,
        n_items: u64,
        read: fn(Arc<Ring<1>>) -> T,
    ) -> Vec<T> {
        let new = move || {
            let ring = Arc::new(Ring::with_spare(n_slots, 0, 1).unwrap());
            (Arc::clone(&ring), ring)
        };
        let publish = |ring: &Ring<1>, n: u64| ring.publish(&[n + 1], &[n as f64]);
        outcomes(new, move |ring| (0..n_items).for_each(|n| publish(&ring, n)), read)
    }

    #[test]
    fn an_item_is_whole_or_absent() {
        let of_two = of_ring(1, 3, |ring| [0, 1].map(|n| read(&ring, n)));
        let whole = [0, 1].map(|n| Some(item(n)));
        assert_eq!(of_two, [[None; 2], [None, whole[1]], [whole[0], None], whole]);
    }

    #[test]
    fn what_the_head_announces_is_there() {
        let found = of_ring(2, 2, |ring| (0..ring.head()).map(|n| read(&ring, n)).collect::<Vec<_>>());
        let whole = vec![Some(item(0)), Some(item(1))];
        assert_eq!(found, [vec![], whole[..1].to_vec(), whole]);
    }

    #[test]
    fn the_newest_is_never_older_than_one_seen_before() {
        let pairs = of_ring(1, 3, |ring| [0, 1].map(|_| newest(&ring)));
        let known: Vec<_> = std::iter::once(None).chain((0..3).map(|n| Some((n, item(n))))).collect();
        let wanted: Vec<_> =
            known.iter().enumerate().flat_map(|(i, a)| known[i..].iter().map(move |b| [*a, *b])).collect();
        assert_eq!(pairs, wanted);
    }

    /// A buffer of one row of two axes, with one slot to spare.
    fn buffer() -> (Writer, Reader) {
        wrench_buffer(BufferSpec { seconds: 1.0, rate_hz: 1.0, tick_hz: 1.0, reorder_depth: 0, n_axes: 2 })
            .unwrap()
    }

    fn row(ticks: u64, host_s: u64) -> Row<[f64; 2]> {
        Row { ticks, host_ns: 1_000_000_000 * host_s, wrench: [ticks as f64; 2], flags: 0 }
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
                let mut rows = [BufferedRow { row: row(0, 0), missing_before: 0, epoch: 0 }];
                let taken = reader.read(&mut rows).unwrap();
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
