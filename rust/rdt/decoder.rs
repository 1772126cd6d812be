//! From datagrams to rows in newton and newton metre: everything between the socket and the buffer, without either.

use super::counts::Counts;
use super::record::{records, Record};
use super::scale::Scale;
use super::sequence::{Placed, Sequence};
use super::variant::Variant;
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

/// A record that passed every check but that of its place.
#[derive(Clone, Copy, Debug)]
struct Sample {
    wrench: [f64; 6],
    flags: u8,
    warning: bool,
    host_ns: u64,
}

/// Turns the datagrams of one stream into rows, and counts.
///
/// Allocates at construction only. Any bytes may be given: what is no record is counted, never guessed.
#[derive(Debug)]
pub struct Decoder {
    variant: Variant,
    scale: Scale,
    limits: [f64; 6],
    sequence: Sequence<Sample>,
    counts: Counts,
}

impl Decoder {
    /// A decoder that rejects records beyond `limits`, in N and N m; infinite ones reject nothing.
    #[must_use]
    pub fn new(variant: Variant, scale: Scale, limits: [f64; 6]) -> Self {
        Self { variant, scale, limits, sequence: Sequence::default(), counts: Counts::default() }
    }

    /// Takes a datagram that arrived at `host_ns`.
    pub fn datagram(&mut self, bytes: &[u8], host_ns: u64, sink: &mut impl FnMut(Decoded)) {
        self.counts.datagrams += 1;
        let Some(records) = records(bytes) else {
            self.counts.malformed += 1;
            return;
        };
        for record in records {
            self.record(&record, host_ns, sink);
        }
    }

    /// The stream has ended: a record that waits for the next one is given up.
    pub fn finish(&mut self) {
        self.sequence.finish(&mut self.counts);
    }

    /// What was counted so far.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Whether a record waits for the next one, and is counted among the records only.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        self.sequence.is_waiting()
    }

    fn record(&mut self, record: &Record, host_ns: u64, sink: &mut impl FnMut(Decoded)) {
        self.counts.records += 1;
        let wrench = self.scale.wrench(record.counts);
        // Impossible forces make its numbers unbelievable too: they must not move the sequence.
        if wrench.iter().zip(self.limits).any(|(value, limit)| value.abs() > limit) {
            self.counts.out_of_range += 1;
            return;
        }
        let (mut flags, warning) = self.variant.judge(record.status);
        if record.counts.iter().any(|count| matches!(*count, i32::MIN | i32::MAX)) {
            flags |= SATURATED;
        }
        let sample = Sample { wrench, flags, warning, host_ns };
        let Self { sequence, counts, .. } = self;
        let mut marks = [0; 3];
        let mut hand_on = |placed| match placed {
            Placed::Row { ticks, item: Sample { wrench, flags, warning, host_ns } } => {
                marks[0] += u64::from(flags & BAD_STATUS != 0);
                marks[1] += u64::from(flags & SATURATED != 0);
                marks[2] += u64::from(warning);
                sink(Decoded::Row(Row { ticks, host_ns, wrench, flags }));
            }
            Placed::NewEpoch => sink(Decoded::NewEpoch),
        };
        sequence.push(record.rdt_sequence, record.ft_sequence, sample, counts, &mut hand_on);
        let [bad_status, saturated, warnings] = marks;
        counts.bad_status += bad_status;
        counts.saturated += saturated;
        counts.warnings += warnings;
    }
}
