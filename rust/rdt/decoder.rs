//! From datagrams to rows in newton and newton metre, in order or not: everything between the socket and the buffer, without
//! either. The socket takes no datagram of another box; the buffer judges rows once more, by device time.
//!
//! A record carries two numbers: its place in the stream (`rdt`) and the sensor's own count of samples (`ft`), both
//! of 32 bits and both wrapping. The first record, and one that fits neither the next places nor the last ones, is
//! believed only when the record after it continues it, as RTP does (RFC 3550, appendix A.1): a stray datagram then
//! costs nothing, and a restarted box is a new epoch, not 4 billion lost records.

use super::{records, Counts, Record, Scale, Variant};
use crate::buffer::Row;
use crate::wrench::{BAD_STATUS, SATURATED};

/// What a decoder hands on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decoded {
    /// A sample; its ticks are those of the sensor's own clock.
    Row(Row),
    /// The box has started again, or another stream has begun: what follows has a time axis of its own.
    NewEpoch,
}

/// Turns the datagrams of one stream into rows, and counts.
///
/// Allocates at construction only. Any bytes may be given: what is no record is counted, never guessed.
#[derive(Debug)]
pub struct Decoder {
    variant: Variant,
    scale: Scale,
    limits: [f64; 6],
    sequence: Sequence,
}

impl Decoder {
    /// A decoder that rejects records beyond `limits`, in N and N m; infinite ones reject nothing.
    #[must_use]
    pub fn new(variant: Variant, scale: Scale, limits: [f64; 6]) -> Self {
        let seen = vec![None; WINDOW as usize].into_boxed_slice();
        Self { variant, scale, limits, sequence: Sequence { seen, ..Sequence::default() } }
    }

    /// Takes a datagram that arrived at `host_ns`.
    pub fn datagram(&mut self, bytes: &[u8], host_ns: u64, sink: &mut impl FnMut(Decoded)) {
        self.sequence.counts.datagrams += 1;
        let Some(records) = records(bytes) else {
            self.sequence.counts.malformed += 1;
            return;
        };
        for record in records {
            self.record(&record, host_ns, sink);
        }
    }

    /// The stream has ended: a record that waits for the next one is given up.
    pub fn finish(&mut self) {
        self.sequence.drop_suspect();
    }

    /// What was counted so far.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.sequence.counts
    }

    /// Whether a record waits for the next one, and is counted among the records only.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        self.sequence.suspect.is_some()
    }

    fn record(&mut self, record: &Record, host_ns: u64, sink: &mut impl FnMut(Decoded)) {
        let Record { rdt_sequence: rdt, ft_sequence: ft, status, counts } = *record;
        self.sequence.counts.records += 1;
        let wrench = self.scale.wrench(counts);
        // Impossible forces make its numbers unbelievable too: they must not move the sequence.
        if wrench.iter().zip(self.limits).any(|(value, limit)| value.abs() > limit) {
            self.sequence.counts.out_of_range += 1;
            return;
        }
        let (mut flags, warning) = self.variant.judge(status);
        if counts.iter().any(|count| matches!(*count, i32::MIN | i32::MAX)) {
            flags |= SATURATED;
        }
        self.sequence.place(Entry { rdt, ft, wrench, flags, warning, host_ns }, sink);
    }
}

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

/// A record that passed every check but that of its place.
#[derive(Clone, Copy, Debug)]
struct Entry {
    rdt: u32,
    ft: u32,
    wrench: [f64; 6],
    flags: u8,
    warning: bool,
    host_ns: u64,
}

#[derive(Clone, Copy, Debug)]
struct Newest {
    rdt: u32,
    ft: u32,
    ticks: u64,
}

/// Where a record stands in its stream by its numbers: next, late, again, lost ones before it, or the first of a new stream.
#[derive(Debug, Default)]
struct Sequence {
    counts: Counts,
    newest: Option<Newest>,
    /// The `ft` of each place behind the newest, by `rdt` modulo `WINDOW`; `None` where nothing came yet.
    seen: Box<[Option<u32>]>,
    /// How many places behind the newest belong to this stream: each is seen or counted as lost.
    reach: u32,
    /// Samples per record, as last seen; 0 while unknown.
    step: u32,
    suspect: Option<Entry>,
}

impl Sequence {
    fn place(&mut self, entry: Entry, sink: &mut impl FnMut(Decoded)) {
        let Some(newest) = self.newest else { return self.hold_suspect(entry, sink) };
        let ahead = distance(newest.rdt, entry.rdt);
        let samples = distance(newest.ft, entry.ft);
        if ahead > 0 {
            if ahead.unsigned_abs() <= WINDOW && self.fits(ahead, samples) {
                self.drop_suspect();
                return self.step(entry, newest, sink);
            }
        } else if ahead.unsigned_abs() <= self.reach {
            let seen = self.seen[slot(entry.rdt)];
            if seen == Some(entry.ft) {
                self.drop_suspect();
                self.counts.duplicates += 1;
                return;
            }
            if seen.is_none() && self.late(entry, newest, sink) {
                return;
            }
        }
        self.hold_suspect(entry, sink);
    }

    /// Whether so many samples are to be expected over so many records.
    fn fits(&self, records: i32, samples: i32) -> bool {
        let most = u64::from(records.unsigned_abs()) * u64::from(self.step) * STEP_FACTOR + STEP_SLACK;
        samples >= 0 && (self.step == 0 || u64::from(samples.unsigned_abs()) <= most)
    }

    /// The first record of a stream.
    fn begin(&mut self, entry: Entry, sink: &mut impl FnMut(Decoded)) {
        self.seen.fill(None);
        self.seen[slot(entry.rdt)] = Some(entry.ft);
        // Streams are numbered from 1: what is missing before the first that came was sent.
        self.reach = if entry.rdt < WINDOW { entry.rdt.saturating_sub(1) } else { 0 };
        self.step = 0;
        let ticks = u64::from(entry.ft);
        self.newest = Some(Newest { rdt: entry.rdt, ft: entry.ft, ticks });
        self.counts.lost += u64::from(self.reach);
        self.hand_on(entry, ticks, sink);
    }

    /// A record that comes next, or after a few lost ones.
    fn step(&mut self, entry: Entry, newest: Newest, sink: &mut impl FnMut(Decoded)) {
        let records = entry.rdt.wrapping_sub(newest.rdt);
        let samples = entry.ft.wrapping_sub(newest.ft);
        if records >= WINDOW {
            self.seen.fill(None);
        } else {
            for ahead in 1..=records {
                self.seen[slot(newest.rdt.wrapping_add(ahead))] = None;
            }
        }
        self.seen[slot(entry.rdt)] = Some(entry.ft);
        self.reach = self.reach.saturating_add(records).min(WINDOW - 1);
        self.counts.lost += u64::from(records - 1);
        // 2^64 samples take 80 million years.
        let ticks = newest.ticks.saturating_add(u64::from(samples));
        self.newest = Some(Newest { rdt: entry.rdt, ft: entry.ft, ticks });
        if samples == 0 {
            self.counts.stale += 1;
            return;
        }
        if records == 1 {
            self.step = samples;
        }
        self.hand_on(entry, ticks, sink);
    }

    /// A record at a place counted as lost; the buffer puts it in order, and drops it if an earlier record brought its sample.
    /// False if its sample is none of those before the newest.
    fn late(&mut self, entry: Entry, newest: Newest, sink: &mut impl FnMut(Decoded)) -> bool {
        let (records, samples) = (distance(entry.rdt, newest.rdt), distance(entry.ft, newest.ft));
        let ticks = newest.ticks.checked_sub(u64::from(samples.unsigned_abs()));
        let Some(ticks) = ticks.filter(|_| self.fits(records, samples)) else { return false };
        self.drop_suspect();
        self.seen[slot(entry.rdt)] = Some(entry.ft);
        self.counts.lost -= 1;
        self.counts.reordered += 1;
        self.hand_on(entry, ticks, sink);
        true
    }

    /// A record that continues nothing: it waits until the next one confirms or refutes it.
    fn hold_suspect(&mut self, entry: Entry, sink: &mut impl FnMut(Decoded)) {
        let Some(suspect) = self.suspect.take() else {
            self.suspect = Some(entry);
            return;
        };
        let ahead = distance(suspect.rdt, entry.rdt);
        let samples = distance(suspect.ft, entry.ft);
        if ahead == 0 && samples == 0 {
            self.counts.duplicates += 1;
            self.suspect = Some(suspect);
        } else if !self.confirms(ahead, samples) {
            self.counts.implausible += 1;
            self.suspect = Some(entry);
        } else {
            let (first, second) = if ahead > 0 { (suspect, entry) } else { (entry, suspect) };
            self.leap(first, sink);
            self.place(second, sink);
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
    fn leap(&mut self, entry: Entry, sink: &mut impl FnMut(Decoded)) {
        if let Some(newest) = self.newest {
            let records = distance(newest.rdt, entry.rdt);
            let samples = distance(newest.ft, entry.ft);
            let expected = i64::from(records) * i64::from(self.step);
            // Both numbers must agree on the length of the outage: a new stream agrees by chance once in thousands.
            let error = (i64::from(samples) - expected).abs();
            if records > 0 && samples > 0 && self.step > 0 && error <= expected / 8 {
                return self.step(entry, newest, sink);
            }
            self.counts.restarts += 1;
            sink(Decoded::NewEpoch);
        }
        self.begin(entry, sink);
    }

    fn hand_on(&mut self, entry: Entry, ticks: u64, sink: &mut impl FnMut(Decoded)) {
        let Entry { wrench, flags, warning, host_ns, .. } = entry;
        self.counts.rows += 1;
        self.counts.bad_status += u64::from(flags & BAD_STATUS != 0);
        self.counts.saturated += u64::from(flags & SATURATED != 0);
        self.counts.warnings += u64::from(warning);
        sink(Decoded::Row(Row { ticks, host_ns, wrench, flags }));
    }

    fn drop_suspect(&mut self) {
        if self.suspect.take().is_some() {
            self.counts.implausible += 1;
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
