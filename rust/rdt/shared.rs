//! What the receiver thread tells everyone else: numbers that any thread reads without waiting.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicU8, Ordering::Relaxed};

use super::counts::Counts;

/// How a receiver is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Records come.
    Streaming,
    /// None came for a second.
    Silent,
    /// The operating system refuses to receive.
    Broken,
    /// It was stopped.
    Stopped,
    /// This process was forked from the one whose thread receives: there is none here.
    Forked,
}

const STATES: [State; 4] = [State::Streaming, State::Silent, State::Broken, State::Stopped];

macro_rules! cells {
    ($($name:ident),*) => {
        /// One cell per count.
        #[derive(Debug, Default)]
        struct Cells { $($name: AtomicU64),* }

        impl Cells {
            fn store(&self, counts: &Counts) {
                $(self.$name.store(counts.$name, Relaxed);)*
            }

            fn load(&self) -> Counts {
                Counts { $($name: self.$name.load(Relaxed)),* }
            }
        }

        impl Counts {
            /// The counts by name.
            #[must_use]
            pub fn named(&self) -> Vec<(&'static str, u64)> {
                vec![$((stringify!($name), self.$name)),*]
            }
        }
    };
}

cells!(
    datagrams,
    malformed,
    records,
    rows,
    lost,
    reordered,
    duplicates,
    stale,
    implausible,
    out_of_range,
    restarts,
    bad_status,
    saturated,
    warnings
);

/// Shared between the receiver thread and its owner.
#[derive(Debug, Default)]
pub(super) struct Shared {
    cells: Cells,
    state: AtomicU8,
    /// Spells without a datagram that were longer than the alarm.
    pub(super) stalls: AtomicU64,
    /// Requests for the stream that were sent.
    pub(super) requests: AtomicU64,
    /// Errors of the operating system while receiving.
    pub(super) socket_errors: AtomicU64,
    /// Arrival of the newest datagram, by [`host_ns`](crate::buffer::host_ns).
    pub(super) newest_host_ns: AtomicU64,
    pub(super) stop: AtomicBool,
}

impl Shared {
    pub(super) fn publish(&self, counts: &Counts) {
        self.cells.store(counts);
    }

    pub(super) fn counts(&self) -> Counts {
        self.cells.load()
    }

    pub(super) fn set_state(&self, state: State) {
        let number = STATES.iter().position(|known| *known == state).unwrap_or_default();
        self.state.store(u8::try_from(number).unwrap_or_default(), Relaxed);
    }

    pub(super) fn state(&self) -> State {
        STATES.get(usize::from(self.state.load(Relaxed))).copied().unwrap_or(State::Stopped)
    }
}
