//! Where a record stands in its stream: next, late, again, lost ones before it, or the first of a new stream.
//!
//! A record carries two numbers: its place in the stream (`rdt`) and the sensor's own count of samples (`ft`), both
//! of 32 bits and both wrapping. The first record, and one that fits neither the next places nor the last ones, is
//! believed only when the record after it continues it, as RTP does (RFC 3550, appendix A.1): a stray datagram then
//! costs nothing, and a restarted box is a new epoch, not 4 billion lost records.

use super::counts::Counts;

/// Places behind the newest that are remembered, and the longest leap that needs no confirmation.
const WINDOW: u32 = 1024;

/// How far apart two records that confirm each other may be.
const NEIGHBOURS: u32 = 64;

/// The most samples from one record to the next where no step is known yet: 9 s of a sensor's 7000 a second.
const FIRST_STEP: u32 = 1 << 16;

/// A gap's samples may differ from the usual number per record by this factor (a changed output rate) ...
const STEP_FACTOR: u64 = 16;

/// ... and this many.
const STEP_SLACK: u64 = 1024;

/// What comes of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placed<T> {
    /// A record of the stream, with the sensor's count widened to 64 bits; counts of an epoch never wrap.
    Row {
        /// The count.
        ticks: u64,
        /// What was given with the record.
        item: T,
    },
    /// What follows belongs to a new stream: its ticks say nothing about those before.
    NewEpoch,
}

/// A record's two numbers, and what belongs to it.
#[derive(Clone, Copy, Debug)]
struct Entry<T> {
    rdt: u32,
    ft: u32,
    item: T,
}

#[derive(Clone, Copy, Debug)]
struct Newest {
    rdt: u32,
    ft: u32,
    ticks: u64,
}

/// The logic of one stream. Allocates once, at construction; never blocks.
#[derive(Debug)]
pub struct Sequence<T> {
    newest: Option<Newest>,
    /// The `ft` of each place behind the newest, by `rdt` modulo `WINDOW`; `None` where nothing came yet.
    seen: Box<[Option<u32>]>,
    /// How many places behind the newest belong to this stream: each is seen or counted as lost.
    reach: u32,
    /// Ticks of the newest record that is no longer remembered: nothing late may lie before it.
    forgotten: Option<u64>,
    /// Samples per record, as last seen; 0 while unknown.
    step: u32,
    suspect: Option<Entry<T>>,
}

impl<T: Copy> Default for Sequence<T> {
    fn default() -> Self {
        let seen = vec![None; WINDOW as usize].into_boxed_slice();
        Self { newest: None, seen, reach: 0, forgotten: None, step: 0, suspect: None }
    }
}

impl<T: Copy> Sequence<T> {
    /// Takes a record in the order of arrival, and hands on what is certain by now.
    pub fn push(
        &mut self,
        rdt: u32,
        ft: u32,
        item: T,
        counts: &mut Counts,
        sink: &mut impl FnMut(Placed<T>),
    ) {
        self.place(Entry { rdt, ft, item }, counts, sink);
    }

    /// Nothing more will come: a record that waits for the next one is given up.
    pub fn finish(&mut self, counts: &mut Counts) {
        self.drop_suspect(counts);
    }

    /// Whether a record waits for the next one.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        self.suspect.is_some()
    }

    fn place(&mut self, entry: Entry<T>, counts: &mut Counts, sink: &mut impl FnMut(Placed<T>)) {
        let Some(newest) = self.newest else { return self.doubt(entry, counts, sink) };
        let ahead = distance(newest.rdt, entry.rdt);
        let samples = distance(newest.ft, entry.ft);
        if ahead > 0 {
            if ahead.unsigned_abs() <= WINDOW && self.fits(ahead, samples) {
                self.drop_suspect(counts);
                return self.advance(entry, newest, counts, sink);
            }
        } else if ahead.unsigned_abs() <= self.reach {
            match self.seen[slot(entry.rdt)] {
                Some(ft) if ft == entry.ft => {
                    self.drop_suspect(counts);
                    counts.duplicates += 1;
                    return;
                }
                Some(_) => {}
                None => {
                    if self.late(entry, newest, counts, sink) {
                        return;
                    }
                }
            }
        }
        self.doubt(entry, counts, sink);
    }

    /// Whether so many samples are to be expected over so many records.
    fn fits(&self, records: i32, samples: i32) -> bool {
        let most = u64::from(records.unsigned_abs()) * u64::from(self.step) * STEP_FACTOR + STEP_SLACK;
        samples >= 0 && (self.step == 0 || u64::from(samples.unsigned_abs()) <= most)
    }

    /// The first record of a stream.
    fn begin(&mut self, entry: Entry<T>, counts: &mut Counts, sink: &mut impl FnMut(Placed<T>)) {
        self.seen.fill(None);
        self.seen[slot(entry.rdt)] = Some(entry.ft);
        // Streams are numbered from 1: what is missing before the first that came was sent.
        self.reach = if entry.rdt < WINDOW { entry.rdt.saturating_sub(1) } else { 0 };
        self.step = 0;
        self.forgotten = None;
        let ticks = u64::from(entry.ft);
        self.newest = Some(Newest { rdt: entry.rdt, ft: entry.ft, ticks });
        counts.lost += u64::from(self.reach);
        counts.rows += 1;
        sink(Placed::Row { ticks, item: entry.item });
    }

    /// A record that comes next, or after a few lost ones.
    fn advance(
        &mut self,
        entry: Entry<T>,
        newest: Newest,
        counts: &mut Counts,
        sink: &mut impl FnMut(Placed<T>),
    ) {
        let records = entry.rdt.wrapping_sub(newest.rdt);
        let samples = entry.ft.wrapping_sub(newest.ft);
        if records >= WINDOW {
            self.seen.fill(None);
            self.forgotten = Some(newest.ticks);
        } else {
            for ahead in 1..=records {
                let left = self.seen[slot(newest.rdt.wrapping_add(ahead))].take();
                let ticks =
                    left.and_then(|ft| newest.ticks.checked_add_signed(distance(newest.ft, ft).into()));
                self.forgotten = self.forgotten.max(ticks);
            }
        }
        self.seen[slot(entry.rdt)] = Some(entry.ft);
        self.reach = self.reach.saturating_add(records).min(WINDOW - 1);
        counts.lost += u64::from(records - 1);
        // 2^64 samples take 80 million years.
        let ticks = newest.ticks.saturating_add(u64::from(samples));
        self.newest = Some(Newest { rdt: entry.rdt, ft: entry.ft, ticks });
        if samples == 0 {
            counts.stale += 1;
            return;
        }
        if records == 1 {
            self.step = samples;
        }
        counts.rows += 1;
        sink(Placed::Row { ticks, item: entry.item });
    }

    /// A record at a place counted as lost. Returns whether its sample fits between those around it.
    fn late(
        &mut self,
        entry: Entry<T>,
        newest: Newest,
        counts: &mut Counts,
        sink: &mut impl FnMut(Placed<T>),
    ) -> bool {
        let behind = newest.rdt.wrapping_sub(entry.rdt);
        let at = |distance: u32| self.seen[slot(newest.rdt.wrapping_sub(distance))];
        let after = (0..behind).rev().find_map(at).map_or(0, |ft| distance(newest.ft, ft));
        let before = (behind + 1..=self.reach).find_map(at).map_or(i32::MIN, |ft| distance(newest.ft, ft));
        let samples = distance(newest.ft, entry.ft);
        let ticks = newest.ticks.checked_add_signed(i64::from(samples));
        let fits = |ticks: &u64| (before..=after).contains(&samples) && Some(*ticks) > self.forgotten;
        let Some(ticks) = ticks.filter(fits) else { return false };
        self.drop_suspect(counts);
        self.seen[slot(entry.rdt)] = Some(entry.ft);
        counts.lost -= 1;
        if samples == before || samples == after {
            counts.stale += 1;
        } else {
            counts.reordered += 1;
            counts.rows += 1;
            sink(Placed::Row { ticks, item: entry.item });
        }
        true
    }

    /// A record that continues nothing: kept until the next one says what it was.
    fn doubt(&mut self, entry: Entry<T>, counts: &mut Counts, sink: &mut impl FnMut(Placed<T>)) {
        let Some(suspect) = self.suspect.take() else {
            self.suspect = Some(entry);
            return;
        };
        let ahead = distance(suspect.rdt, entry.rdt);
        let samples = distance(suspect.ft, entry.ft);
        if ahead == 0 && samples == 0 {
            counts.duplicates += 1;
            self.suspect = Some(suspect);
        } else if !self.confirms(ahead, samples) {
            counts.implausible += 1;
            self.suspect = Some(entry);
        } else {
            let (first, second) = if ahead > 0 { (suspect, entry) } else { (entry, suspect) };
            self.leap(first, counts, sink);
            self.place(second, counts, sink);
        }
    }

    /// Whether a record so far from a doubted one continues it, or comes before it.
    fn confirms(&self, records: i32, samples: i32) -> bool {
        if !(1..=NEIGHBOURS).contains(&records.unsigned_abs()) {
            return false;
        }
        if self.newest.is_some() {
            return records.signum() * samples.signum() > 0;
        }
        // A box may begin with one sample under two numbers; a counter that leaps is none.
        let most = records.unsigned_abs() * FIRST_STEP;
        records.signum() * samples.signum() >= 0 && samples.unsigned_abs() <= most
    }

    /// A record far from the last, and confirmed: after a long outage, or of a new stream.
    fn leap(&mut self, entry: Entry<T>, counts: &mut Counts, sink: &mut impl FnMut(Placed<T>)) {
        if let Some(newest) = self.newest {
            let records = distance(newest.rdt, entry.rdt);
            let samples = distance(newest.ft, entry.ft);
            let expected = i64::from(records) * i64::from(self.step);
            // Both numbers must agree on the length of the outage: a new stream agrees by chance once in thousands.
            let error = (i64::from(samples) - expected).abs();
            if records > 0 && samples > 0 && self.step > 0 && error <= expected / 8 {
                return self.advance(entry, newest, counts, sink);
            }
            counts.restarts += 1;
            sink(Placed::NewEpoch);
        }
        self.begin(entry, counts, sink);
    }

    fn drop_suspect(&mut self, counts: &mut Counts) {
        if self.suspect.take().is_some() {
            counts.implausible += 1;
        }
    }
}

/// How far `to` is ahead of `from`, by the shorter way round.
fn distance(from: u32, to: u32) -> i32 {
    to.wrapping_sub(from).cast_signed()
}

fn slot(rdt: u32) -> usize {
    (rdt % WINDOW) as usize
}
