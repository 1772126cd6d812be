//! What happened to the rows that were pushed.

use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {
        /// Counts since the buffer was made. Each row pushed is in exactly one of `written`, `held`, `duplicates`,
        /// `stale`, `late` and `non_finite`.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        #[non_exhaustive]
        pub struct Stats { $($(#[$doc])* pub $name: u64,)* }

        /// The counts as one thread keeps them and others read them; on cache lines of their own, as what lies beside
        /// them is read all the time.
        #[derive(Default)]
        #[repr(align(128))]
        pub(super) struct Counters { $(pub(super) $name: Counter,)* }

        impl Counters {
            pub(super) fn stats(&self) -> Stats {
                Stats { $($name: self.$name.0.load(Relaxed),)* }
            }
        }

        impl Stats {
            /// Names and counts, in order.
            #[must_use]
            pub fn named(&self) -> Vec<(&'static str, u64)> {
                vec![$((stringify!($name), self.$name),)*]
            }
        }
    };
}

counters! {
    /// Rows that readers got, or could have got.
    written,
    /// Rows that wait for a late one at this moment.
    held,
    /// Rows dropped because their device time was there already.
    duplicates,
    /// Rows dropped because a packet with another number had brought the same device time: the device measured nothing
    /// new.
    stale,
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
#[derive(Default)]
pub(super) struct Counter(AtomicU64);

impl Counter {
    #[inline]
    pub(super) fn add(&self, n: u64) {
        // A load and a store: cheaper than an atomic addition, and exact with one writer.
        self.set(self.0.load(Relaxed).wrapping_add(n));
    }

    #[inline]
    pub(super) fn set(&self, n: u64) {
        self.0.store(n, Relaxed);
    }
}
