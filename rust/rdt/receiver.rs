//! The thread that receives: owns the socket's incoming side and the buffer's writer, and never waits for Python.

use std::net::UdpSocket;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::Arc;
use std::thread::JoinHandle;

use super::counts::Counts;
use super::decoder::Decoder;
use super::fault::Fault;
use super::request::Request;
use super::settings::Settings;
use super::shared::{Shared, State};
use super::socket;
use super::work::Work;
use crate::buffer::{host_ns, Writer};

/// A running stream: rows go into the writer until [`stop`](Receiver::stop).
///
/// The thread blocks in the operating system until a datagram is there, and takes datagrams as long as there are any.
/// It never allocates and takes no lock while it runs. Dropping stops.
///
/// After a fork the child has the object and no thread: there it reports [`State::Forked`], and stopping or dropping it
/// sends nothing, as the stream is the parent's.
#[derive(Debug)]
pub struct Receiver {
    shared: Arc<Shared>,
    socket: UdpSocket,
    settings: Settings,
    thread: Option<JoinHandle<Option<Writer>>>,
    process: u32,
    receive_buffer: usize,
}

impl Receiver {
    /// Asks the box for the stream and waits for its first two records, which confirm each other. The writer comes back with a fault.
    ///
    /// Where the box is silent, blocks for a second, or thirty periods if that is longer.
    pub fn start(settings: Settings, mut writer: Writer) -> Result<Self, Box<(Fault, Writer)>> {
        let mut decoder = Decoder::new(settings.variant, settings.scale, settings.limits);
        match Self::connect(&settings, &mut decoder, &mut writer) {
            Ok((socket, incoming, shared, receive_buffer)) => {
                let work = Work::new(incoming, decoder, settings.clone(), Arc::clone(&shared), writer);
                let thread = Some(spawn(work, &settings)?);
                Ok(Self { shared, socket, settings, thread, process: std::process::id(), receive_buffer })
            }
            Err(fault) => Err(Box::new((fault, writer))),
        }
    }

    /// The socket twice, for asking and for receiving, and how many bytes it may hold.
    fn connect(
        settings: &Settings,
        decoder: &mut Decoder,
        writer: &mut Writer,
    ) -> Result<(UdpSocket, UdpSocket, Arc<Shared>, usize), Fault> {
        settings.check()?;
        let (socket, receive_buffer) = socket::connected(settings)?;
        let incoming =
            socket.try_clone().map_err(|error| socket::system("sharing a socket to", settings, &error))?;
        let shared = Arc::new(Shared::default());
        let requests = socket::first_rows(&socket, settings, decoder, writer)?;
        shared.requests.store(u64::from(requests), Relaxed);
        shared.publish(decoder.counts());
        shared.newest_host_ns.store(host_ns(), Relaxed);
        Ok((socket, incoming, shared, receive_buffer))
    }

    /// Ends the stream and gives the writer back; `None` when that was done already, or in a forked child.
    ///
    /// Datagrams that arrived before are still taken. Blocks for some hundredths of a second.
    pub fn stop(&mut self) -> Option<Writer> {
        let thread = self.thread.take()?;
        if self.process != std::process::id() {
            // Joining or detaching a thread that is not there is not defined.
            std::mem::forget(thread);
            return None;
        }
        self.shared.stop.store(true, Relaxed);
        thread.join().ok().flatten()
    }

    /// Makes the present load the new zero, for every client of the box. The box does not answer.
    pub fn bias(&self) -> Result<(), Fault> {
        self.send(self.settings.bias_request())
    }

    /// Forgets which thresholds were exceeded.
    pub fn reset_threshold_latch(&self) -> Result<(), Fault> {
        self.send(Request::ResetThresholdLatch)
    }

    /// How the receiver is.
    #[must_use]
    pub fn state(&self) -> State {
        if self.process == std::process::id() {
            self.shared.state()
        } else {
            State::Forked
        }
    }

    /// What was counted so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.shared.counts()
    }

    /// What was counted so far, by name: the fields of [`Counts`], and of the transport `stalls` (spells without a
    /// datagram longer than 20 ms, or three periods), `requests` for the stream, `socket_errors`, and
    /// `receive_buffer_bytes` as the system granted them.
    #[must_use]
    pub fn counters(&self) -> Vec<(&'static str, u64)> {
        let mut counters = self.counts().named();
        counters.extend([
            ("stalls", self.shared.stalls.load(Relaxed)),
            ("requests", self.shared.requests.load(Relaxed)),
            ("socket_errors", self.shared.socket_errors.load(Relaxed)),
            ("receive_buffer_bytes", self.receive_buffer as u64),
        ]);
        counters
    }

    /// Nanoseconds since the newest datagram.
    #[must_use]
    pub fn silent_ns(&self) -> u64 {
        host_ns().saturating_sub(self.shared.newest_host_ns.load(Relaxed))
    }

    fn send(&self, request: Request) -> Result<(), Fault> {
        let sent = self.socket.send(&request.bytes());
        sent.map(drop).map_err(|error| socket::system("sending to", &self.settings, &error))
    }
}

impl Drop for Receiver {
    fn drop(&mut self) {
        self.stop();
    }
}

/// A thread for the work; where the system gives none, the writer comes back.
fn spawn(work: Work, settings: &Settings) -> Result<JoinHandle<Option<Writer>>, Box<(Fault, Writer)>> {
    // A closure that fails to become a thread is dropped with all it holds: it gets the work only when it runs.
    let (give, take) = std::sync::mpsc::channel::<Work>();
    let thread = std::thread::Builder::new()
        .name("granular-id-rdt".to_owned())
        .spawn(move || take.recv().ok().map(Work::run));
    match thread {
        Ok(thread) => match give.send(work) {
            Ok(()) => Ok(thread),
            Err(returned) => Err(Box::new((socket::gone(settings), returned.0.into_writer()))),
        },
        Err(error) => {
            Err(Box::new((socket::system("starting a thread for", settings, &error), work.into_writer())))
        }
    }
}
