//! The thread that receives: owns the socket's incoming side and the buffer's writer, and never waits for Python.

use std::io::{Error, ErrorKind};
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering::Relaxed};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use socket2::{Domain, Protocol, Socket, Type};

use super::{Cells, Counts, Decoded, Decoder, RdtError, Request, Settings, MAX_RECORDS, RECORD_BYTES};
use crate::buffer::{host_ns, Counter, Writer};
use crate::specs::choices;
use crate::wrench::AXES;

/// Requested from the system for datagrams that wait: half a minute at 500 Hz, five seconds at 7000 Hz.
const RECEIVE_BUFFER: usize = 4 << 20;

/// Bytes of the longest datagram, and one by which a longer one is recognised.
const ROOM: usize = RECORD_BYTES * MAX_RECORDS + 1;

/// Requests for the stream, as any of them may be lost, ...
const ATTEMPTS: u32 = 10;

/// ... and how long each may take.
const PATIENCE: Duration = Duration::from_millis(100);

/// The thread looks this often whether it is to stop.
const WAKE: Duration = Duration::from_millis(20);

/// Without a datagram for so long the stream counts as ended.
const SILENCE: Duration = Duration::from_secs(1);

/// After an error of the operating system that may be lasting.
const PAUSE: Duration = Duration::from_millis(10);

/// A stop request may be lost like any datagram: it is repeated until nothing comes any more, so often at most.
const STOPS: usize = 10;

/// Datagrams still taken once the thread is to stop: more than 4 MB hold.
const LAST_DATAGRAMS: usize = 1 << 17;

/// How a receiver is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
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

choices! {
    State:
    "streaming" Streaming,
    "silent" Silent,
    "broken" Broken,
    "stopped" Stopped,
    "forked" Forked,
}

/// The states a thread can be in, in their order.
const STATES: [State; 4] = [State::Streaming, State::Silent, State::Broken, State::Stopped];

/// The state of the thread in numbers that any other thread reads without waiting.
#[derive(Debug, Default)]
struct Progress {
    counts: Cells,
    state: AtomicU8,
    /// Spells without a datagram that were longer than the alarm.
    stalls: Counter,
    /// Requests for the stream that were sent.
    requests: Counter,
    /// Errors of the operating system while receiving.
    socket_errors: Counter,
    /// Arrival of the newest datagram, by [`host_ns`].
    newest_host_ns: Counter,
    stop: AtomicBool,
}

impl Progress {
    fn set_state(&self, state: State) {
        self.state.store(state as u8, Relaxed);
    }

    fn state(&self) -> State {
        STATES.get(usize::from(self.state.load(Relaxed))).copied().unwrap_or(State::Stopped)
    }
}

/// A running stream: rows go into the writer until [`stop`](Receiver::stop).
///
/// The thread blocks in the operating system until a datagram is there, and takes datagrams as long as there are any.
/// It never allocates and takes no lock while it runs. Dropping stops.
///
/// After a fork the child has the object and no thread: there it reports [`State::Forked`], and stopping or dropping it
/// sends nothing, as the stream is the parent's.
#[derive(Debug)]
pub struct Receiver {
    progress: Arc<Progress>,
    socket: UdpSocket,
    settings: Settings,
    thread: Option<JoinHandle<Option<Writer>>>,
    process: u32,
    receive_buffer: usize,
}

impl Receiver {
    /// Requests the stream from the box and waits for its first two records, which confirm each other. The writer comes back with
    /// an error.
    ///
    /// Where the box is silent, blocks for a second, or thirty periods if that is longer.
    pub fn start(settings: Settings, mut writer: Writer) -> Result<Self, Box<(RdtError, Writer)>> {
        let mut decoder = Decoder::new(settings.variant, settings.scale, settings.limits);
        let mut connect = || {
            settings.check()?;
            let n_axes = writer.spec().n_axes;
            if n_axes != AXES.len() {
                return Err(RdtError::Setting {
                    what: "n_axes",
                    wanted: "6".to_owned(),
                    value: n_axes as f64,
                });
            }
            let (socket, receive_buffer) = connected(&settings)?;
            let incoming =
                socket.try_clone().map_err(|error| failed("sharing a socket to", &settings, &error))?;
            let requests = first_rows(&socket, &settings, &mut decoder, &mut writer)?;
            Ok((socket, incoming, receive_buffer, requests))
        };
        let (socket, incoming, receive_buffer, requests) = match connect() {
            Ok(connected) => connected,
            Err(error) => return Err(Box::new((error, writer))),
        };
        let progress = Arc::new(Progress::default());
        progress.requests.set(u64::from(requests));
        progress.counts.store(decoder.counts());
        progress.newest_host_ns.set(host_ns());
        let receiver_loop = ReceiverLoop {
            socket: incoming,
            decoder,
            settings: settings.clone(),
            progress: Arc::clone(&progress),
            writer,
            newest: Instant::now(),
            stalled: false,
        };
        let thread = Some(spawn(receiver_loop, &settings)?);
        Ok(Self { progress, socket, settings, thread, process: std::process::id(), receive_buffer })
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
        self.progress.stop.store(true, Relaxed);
        thread.join().ok().flatten()
    }

    /// Makes the present load the new zero, for every client of the box. The box does not answer.
    pub fn bias(&self) -> Result<(), RdtError> {
        self.send(self.settings.bias_request())
    }

    /// How the receiver is.
    #[must_use]
    pub fn state(&self) -> State {
        if self.process == std::process::id() {
            self.progress.state()
        } else {
            State::Forked
        }
    }

    /// What was counted so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.progress.counts.load()
    }

    /// What was counted so far, by name: the fields of [`Counts`], and of the transport `stalls` (spells without a
    /// datagram longer than 20 ms, or three periods), `requests` for the stream, `socket_errors`, and
    /// `receive_buffer_bytes` as the system granted them.
    #[must_use]
    pub fn counters(&self) -> Vec<(&'static str, u64)> {
        let mut counters = self.counts().named();
        counters.extend([
            ("stalls", self.progress.stalls.get()),
            ("requests", self.progress.requests.get()),
            ("socket_errors", self.progress.socket_errors.get()),
            ("receive_buffer_bytes", self.receive_buffer as u64),
        ]);
        counters
    }

    /// Nanoseconds since the newest datagram.
    #[must_use]
    pub fn silent_ns(&self) -> u64 {
        host_ns().saturating_sub(self.progress.newest_host_ns.get())
    }

    fn send(&self, request: Request) -> Result<(), RdtError> {
        let sent = self.socket.send(&request.bytes());
        sent.map(drop).map_err(|error| failed("sending to", &self.settings, &error))
    }
}

impl Drop for Receiver {
    fn drop(&mut self) {
        self.stop();
    }
}

/// A thread for the loop; where the system gives none, the writer comes back.
fn spawn(
    receiver_loop: ReceiverLoop,
    settings: &Settings,
) -> Result<JoinHandle<Option<Writer>>, Box<(RdtError, Writer)>> {
    // A closure that fails to become a thread is dropped with all it holds: it gets the loop only when it runs.
    let (give, take) = std::sync::mpsc::channel::<ReceiverLoop>();
    let thread = std::thread::Builder::new()
        .name("granular-id-rdt".to_owned())
        .spawn(move || take.recv().ok().map(ReceiverLoop::run));
    let (error, receiver_loop) = match thread {
        Ok(thread) => match give.send(receiver_loop) {
            Ok(()) => return Ok(thread),
            Err(returned) => (Error::other("it ended at once"), returned.0),
        },
        Err(error) => (error, receiver_loop),
    };
    Err(Box::new((failed("starting a thread for", settings, &error), receiver_loop.writer)))
}

/// The work of the thread until it is stopped, and all it owns.
struct ReceiverLoop {
    socket: UdpSocket,
    decoder: Decoder,
    settings: Settings,
    progress: Arc<Progress>,
    writer: Writer,
    newest: Instant,
    stalled: bool,
}

impl ReceiverLoop {
    fn run(mut self) -> Writer {
        let mut bytes = [0; ROOM];
        let ready =
            self.socket.set_nonblocking(false).and_then(|()| self.socket.set_read_timeout(Some(WAKE)));
        if ready.is_err() {
            self.progress.set_state(State::Broken);
            return self.writer;
        }
        while !self.progress.stop.load(Relaxed) {
            let received = self.socket.recv(&mut bytes);
            self.received(received, &bytes);
        }
        self.end(&mut bytes);
        self.writer
    }

    fn received(&mut self, received: std::io::Result<usize>, bytes: &[u8]) {
        match received {
            Ok(length) => self.take(bytes.get(..length).unwrap_or_default()),
            Err(error) => match error.kind() {
                ErrorKind::Interrupted => {}
                ErrorKind::WouldBlock | ErrorKind::TimedOut => self.silence(),
                _ => self.error(&error),
            },
        }
    }

    fn take(&mut self, datagram: &[u8]) {
        let (now, now_ns) = (Instant::now(), host_ns());
        if !self.stalled && now - self.newest > self.settings.alarm() {
            self.progress.stalls.add(1);
        }
        self.newest = now;
        self.stalled = false;
        let Self { decoder, writer, progress, .. } = self;
        let n_rows = decoder.counts().rows;
        write(decoder, datagram, now_ns, writer);
        progress.newest_host_ns.set(now_ns);
        progress.counts.store(decoder.counts());
        if decoder.counts().rows > n_rows {
            progress.set_state(State::Streaming);
        }
    }

    fn silence(&mut self) {
        let silent = self.newest.elapsed();
        if !self.stalled && silent > self.settings.alarm() {
            self.stalled = true;
            self.progress.stalls.add(1);
        }
        if silent > SILENCE.max(self.settings.alarm()) {
            self.progress.set_state(State::Silent);
        }
    }

    fn error(&mut self, error: &Error) {
        self.progress.socket_errors.add(1);
        // "Refused" is an answer to an earlier request: the box is not up, and may come up again.
        if error.kind() != ErrorKind::ConnectionRefused {
            self.progress.set_state(State::Broken);
        }
        std::thread::sleep(PAUSE);
        self.silence();
    }

    /// Takes what is there, then requests the end until nothing comes any more.
    fn end(&mut self, bytes: &mut [u8; ROOM]) {
        if self.socket.set_nonblocking(true).is_ok() {
            for _ in 0..LAST_DATAGRAMS {
                match self.socket.recv(bytes) {
                    Ok(length) => self.take(bytes.get(..length).unwrap_or_default()),
                    Err(_) => break,
                }
            }
        }
        self.decoder.finish();
        self.writer.flush();
        self.progress.counts.store(self.decoder.counts());
        stop(&self.socket, bytes);
        self.progress.set_state(State::Stopped);
    }
}

/// A failed call of the operating system.
fn failed(what: &'static str, settings: &Settings, error: &Error) -> RdtError {
    let Settings { host, port, .. } = settings;
    if error.kind() == ErrorKind::ConnectionRefused {
        return RdtError::Refused { host: host.clone(), port: *port };
    }
    RdtError::System { what, host: host.clone(), port: *port, reason: error.to_string() }
}

/// A socket that talks to the box only: the kernel drops what others send. Also the bytes it may hold.
fn connected(settings: &Settings) -> Result<(UdpSocket, usize), RdtError> {
    let address = resolved(settings)?;
    let open = || {
        let socket = Socket::new(Domain::for_address(address), Type::DGRAM, Some(Protocol::UDP))?;
        // Some systems grant less, others refuse: what there is decides how long the thread may wait for its turn, so it is
        // reported.
        let _ = socket.set_recv_buffer_size(RECEIVE_BUFFER);
        socket.connect(&address.into())?;
        let granted = socket.recv_buffer_size()?;
        Ok((UdpSocket::from(socket), granted))
    };
    open().map_err(|error| failed("opening a socket to", settings, &error))
}

fn resolved(settings: &Settings) -> Result<SocketAddr, RdtError> {
    let host = settings.host.as_str();
    let no_address = |reason: String| RdtError::Host { host: host.to_owned(), reason };
    let found = (host, settings.port).to_socket_addrs().map_err(|error| no_address(error.to_string()))?;
    // Boxes speak IPv4: an address of that kind first, where a name has both.
    let mut addresses: Vec<SocketAddr> = found.collect();
    addresses.sort_by_key(SocketAddr::is_ipv6);
    addresses.first().copied().ok_or_else(|| no_address("the name is known, but has none".to_owned()))
}

/// Requests the stream until two records confirm each other and the first rows are in the buffer. Returns the number of
/// requests.
fn first_rows(
    socket: &UdpSocket,
    settings: &Settings,
    decoder: &mut Decoder,
    writer: &mut Writer,
) -> Result<u32, RdtError> {
    let started = Instant::now();
    let mut refused = false;
    let mut bytes = [0; ROOM];
    // A box sends its first records one and two periods after the request.
    let patience = PATIENCE.max(settings.alarm());
    for attempt in 1..=ATTEMPTS {
        for request in settings.start_requests() {
            match socket.send(&request.bytes()) {
                // An answer to the request before: the box may be starting.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => refused = true,
                sent => drop(sent.map_err(|error| failed("sending to", settings, &error))?),
            }
        }
        let until = Instant::now() + patience;
        while let Some(left) = until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) {
            let received = socket.set_read_timeout(Some(left)).and_then(|()| socket.recv(&mut bytes));
            match received {
                Ok(length) => {
                    write(decoder, bytes.get(..length).unwrap_or_default(), host_ns(), writer);
                    if decoder.counts().rows > 0 {
                        return Ok(attempt);
                    }
                }
                Err(error) => match error.kind() {
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => {}
                    ErrorKind::ConnectionRefused => {
                        refused = true;
                        std::thread::sleep(left);
                    }
                    _ => return Err(failed("receiving from", settings, &error)),
                },
            }
        }
    }
    stop(socket, &mut bytes);
    let (host, port) = (settings.host.clone(), settings.port);
    let datagrams = decoder.counts().datagrams;
    Err(if refused && datagrams == 0 {
        RdtError::Refused { host, port }
    } else {
        RdtError::Silent { host, port, waited: started.elapsed(), requests: ATTEMPTS, datagrams }
    })
}

/// Writes what a datagram makes certain into the buffer.
fn write(decoder: &mut Decoder, datagram: &[u8], now_ns: u64, writer: &mut Writer) {
    decoder.datagram(datagram, now_ns, &mut |decoded| match decoded {
        Decoded::Row(row) => {
            // What the buffer does with it, it counts itself. Restarts are reported: a swapped datagram of forty records is
            // late, and no restart.
            writer.push_in_epoch(&row);
        }
        Decoded::NewEpoch => writer.new_epoch(),
    });
}

/// Requests the end of a stream until nothing comes any more.
fn stop(socket: &UdpSocket, bytes: &mut [u8; ROOM]) {
    let quiet = socket.set_nonblocking(false).and_then(|()| socket.set_read_timeout(Some(WAKE)));
    for _ in 0..STOPS {
        // Nothing can be done where this fails; a box that is gone needs no request.
        let sent = socket.send(&Request::Stop.bytes());
        let until = Instant::now() + WAKE;
        if quiet.is_err() || sent.is_err() || !comes_after(socket, bytes, until) {
            return;
        }
    }
}

/// Reads until nothing comes for a while, or the time has passed. Returns whether something came after it.
fn comes_after(socket: &UdpSocket, bytes: &mut [u8; ROOM], until: Instant) -> bool {
    while socket.recv(bytes).is_ok() {
        if Instant::now() > until {
            return true;
        }
    }
    false
}
