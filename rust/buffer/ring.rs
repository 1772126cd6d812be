//! The ring itself: items of a few words in slots that the newest overwrite, read without locks and never torn.
//!
//! Each slot is a sequence lock made of atomics alone: the state of a slot says which item it holds and whether it is
//! complete, and a reader that finds another state after its copy than before throws the copy away. All words are
//! atomics, so an overwritten read is a stale number, never a data race (H.-J. Boehm, "Can seqlocks get along with
//! programming language memory models?", MSPC 2012).

use std::sync::atomic::Ordering::{Acquire, Relaxed, Release};
use std::sync::atomic::{fence, AtomicU64};

use crate::error::Result;
use crate::memory::reserved;

/// One item of `WORDS` words and the state that guards it.
struct Slot<const WORDS: usize> {
    /// `2 n + 1` while item `n` is being written, `2 n + 2` once it is complete, 0 before the first.
    state: AtomicU64,
    words: [AtomicU64; WORDS],
}

/// Items numbered from 0 in a power of two of slots; item `n` takes the slot of item `n - slots`.
///
/// One thread at a time may publish; any number may read.
pub(super) struct Ring<const WORDS: usize> {
    slots: Box<[Slot<WORDS>]>,
    head: Head,
}

/// The number of items published, on a cache line of its own: readers poll it while slots are written.
#[repr(align(128))]
struct Head(AtomicU64);

impl<const WORDS: usize> Ring<WORDS> {
    /// A ring of at least `at_least` slots.
    pub(super) fn new(at_least: usize) -> Result<Self> {
        let n_slots = at_least.checked_next_power_of_two().unwrap_or(usize::MAX);
        let mut slots = reserved(n_slots)?;
        slots.resize_with(n_slots, || Slot {
            state: AtomicU64::new(0),
            words: std::array::from_fn(|_| AtomicU64::new(0)),
        });
        Ok(Self { slots: slots.into_boxed_slice(), head: Head(AtomicU64::new(0)) })
    }

    /// Items published so far: the number of the next.
    #[inline]
    pub(super) fn head(&self) -> u64 {
        self.head.0.load(Acquire)
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

    #[inline]
    fn slot(&self, n: u64) -> &Slot<WORDS> {
        // The number of slots is a power of two: the mask keeps the low bits, which fit.
        #[allow(clippy::cast_possible_truncation)]
        let index = n as usize & (self.slots.len() - 1);
        &self.slots[index]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holds_as_many_items_as_slots() {
        let ring = Ring::<2>::new(3).unwrap();
        assert_eq!(ring.read(0), None);
        for n in 0..9 {
            assert_eq!(ring.head(), n);
            ring.publish(&[n, !n]);
        }
        assert_eq!(ring.read(4), None);
        for n in 5..9 {
            assert_eq!(ring.read(n), Some([n, !n]));
        }
        assert_eq!(ring.read(9), None);
    }

    #[test]
    fn an_item_half_written_is_not_read() {
        let ring = Ring::<1>::new(1).unwrap();
        ring.publish(&[7]);
        ring.slot(1).state.store(3, Relaxed);
        assert_eq!((ring.read(0), ring.read(1)), (None, None));
    }

    #[test]
    fn more_memory_than_there_is_is_refused() {
        assert!(Ring::<8>::new(usize::MAX).is_err());
        assert!(Ring::<8>::new(1 << 62).is_err());
    }
}
