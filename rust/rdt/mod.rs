//! Wrenches from an F/T sensor that speaks RDT over UDP.
//!
//! ATI's Net F/T and Ethernet Axia stream records of 36 bytes to whoever asked last; boxes of `OnRobot` use the same
//! framing. [`Decoder`] turns datagrams into rows without a socket, [`Receiver`] is the thread that feeds it and writes
//! to a [`buffer`](crate::buffer).
//!
//! Source: ATI Industrial Automation, manuals 9620-05-NET FT and 9610-05-Ethernet Axia, chapters on UDP and status codes.

mod counts;
mod decoder;
mod fault;
mod receiver;
mod record;
mod request;
mod scale;
mod sequence;
mod settings;
mod shared;
mod socket;
mod variant;
mod work;

pub use counts::Counts;
pub use decoder::{Decoded, Decoder};
pub use fault::Fault;
pub use receiver::Receiver;
pub use record::{records, Record, MAX_RECORDS, RECORD_BYTES};
pub use request::Request;
pub use scale::{Scale, COUNTS_PER_NEWTON, COUNTS_PER_NEWTON_METRE};
pub use sequence::{Placed, Sequence};
pub use settings::{Settings, PORT};
pub use shared::State;
pub use variant::Variant;
