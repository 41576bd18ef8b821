//! A simulated serial line with faults: bytes in, mostly the same bytes out later.
//!
//! One [`Line`] is one direction. Complete frames are put on it; bytes leave it at the line's rate
//! (10 bits a byte), after the delay, subject to the faults of a [`LinkSpec`]. Time is an argument,
//! in microseconds; random numbers come from one seeded generator per line, so a simulation can be
//! repeated. A stall delays bytes; a pull loses those in transit.

use crate::text::refusal::{Refusal, refusal};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::VecDeque;

/// Bits on the line per byte: start, eight, stop.
const BITS_PER_BYTE: u64 = 10;

/// A period during which the line does not transmit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outage {
    /// When it begins.
    pub start_us: u64,
    /// How long it lasts.
    pub length_us: u64,
}

impl Outage {
    fn end_us(&self) -> u64 {
        self.start_us.saturating_add(self.length_us)
    }

    fn covers(&self, time_us: u64) -> bool {
        (self.start_us..self.end_us()).contains(&time_us)
    }
}

/// What the line does wrong.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkSpec {
    /// Probability that a frame is lost.
    pub drop_per_frame: f64,
    /// Probability that one bit of a byte is flipped.
    pub flip_per_byte: f64,
    /// Probability that a frame is duplicated.
    pub dup_per_frame: f64,
    /// Probability that a frame arrives after the next one.
    pub reorder_per_frame: f64,
    /// Probability that a frame is cut short.
    pub truncate_per_frame: f64,
    /// Transmission delay of a byte.
    pub delay_us: u64,
    /// Periods during which bytes wait.
    pub stalls: Vec<Outage>,
    /// Periods during which bytes are lost.
    pub pulls: Vec<Outage>,
    /// Bits per second.
    pub baud: u64,
}

impl Default for LinkSpec {
    fn default() -> Self {
        LinkSpec {
            drop_per_frame: 0.0,
            flip_per_byte: 0.0,
            dup_per_frame: 0.0,
            reorder_per_frame: 0.0,
            truncate_per_frame: 0.0,
            delay_us: 0,
            stalls: Vec::new(),
            pulls: Vec::new(),
            baud: 1_000_000,
        }
    }
}

impl std::str::FromStr for LinkSpec {
    type Err = Refusal;

    /// Reads `drop=0.01,flip=1e-5,dup=0.001,delay=2ms,stall=2s@5s,pull=1s@20s,baud=115200`; `stall`
    /// and `pull` may be given several times.
    fn from_str(text: &str) -> Result<Self, Refusal> {
        let mut spec = LinkSpec::default();
        for part in text
            .split(',')
            .map(str::trim)
            .filter(|part| !part.is_empty())
        {
            let (key, value) = part.split_once('=').ok_or_else(|| {
                refusal!(
                    "link: `{part}` is not of the form key=value, as in `drop=0.01,stall=2s@5s`"
                )
            })?;
            spec.set(key.trim(), value.trim())?;
        }
        Ok(spec)
    }
}

impl LinkSpec {
    fn set(&mut self, key: &str, value: &str) -> Result<(), Refusal> {
        match key {
            "drop" => self.drop_per_frame = probability(key, value)?,
            "flip" => self.flip_per_byte = probability(key, value)?,
            "dup" => self.dup_per_frame = probability(key, value)?,
            "reorder" => self.reorder_per_frame = probability(key, value)?,
            "truncate" => self.truncate_per_frame = probability(key, value)?,
            "delay" => self.delay_us = time_us(key, value)?,
            "stall" => self.stalls.push(outage(key, value)?),
            "pull" => self.pulls.push(outage(key, value)?),
            "baud" => {
                self.baud = value
                    .parse()
                    .ok()
                    .filter(|baud| (1200..=100_000_000).contains(baud))
                    .ok_or_else(|| {
                        refusal!("link: baud={value}: a whole number from 1200 to 100000000")
                    })?;
            }
            _ => {
                return Err(refusal!(
                    "link: `{key}` is unknown; there are drop, flip, dup, reorder, truncate, delay, stall, pull and baud"
                ));
            }
        }
        Ok(())
    }
}

fn probability(key: &str, value: &str) -> Result<f64, Refusal> {
    value
        .parse()
        .ok()
        .filter(|share| (0.0..=1.0).contains(share))
        .ok_or_else(|| {
            refusal!(
                "link: {key}={value}: a probability is a number from 0 to 1, as in `{key}=0.01`"
            )
        })
}

fn time_us(key: &str, value: &str) -> Result<u64, Refusal> {
    let scales = [("us", 1.0), ("ms", 1e3), ("s", 1e6)];
    scales
        .iter()
        .find_map(|(suffix, scale_us)| {
            let number: f64 = value.strip_suffix(suffix)?.trim().parse().ok()?;
            // A day is longer than any simulated print.
            let in_range = (0.0..=86_400e6).contains(&(number * scale_us));
            in_range.then_some((number * scale_us).round() as u64)
        })
        .ok_or_else(|| {
            refusal!(
                "link: {key}={value}: a time is a number with us, ms or s, as in `2s` or `1.5ms`"
            )
        })
}

fn outage(key: &str, value: &str) -> Result<Outage, Refusal> {
    let (length, start) = value
        .split_once('@')
        .ok_or_else(|| refusal!("link: {key}={value}: write LENGTH@START, as in `{key}=2s@5s`"))?;
    Ok(Outage {
        start_us: time_us(key, start)?,
        length_us: time_us(key, length)?,
    })
}

/// Bytes of one frame in transit.
#[derive(Debug)]
struct Flight {
    /// When its first byte began to leave.
    sent_us: u64,
    /// Bytes not yet delivered start here.
    next: usize,
    bytes: Vec<u8>,
}

/// One direction of the link.
#[derive(Debug)]
pub struct Line {
    spec: LinkSpec,
    random: Pcg64Mcg,
    /// In the order of arrival.
    flights: VecDeque<Flight>,
    /// A frame that waits to be overtaken.
    held: Option<Vec<u8>>,
    /// When the line can take the next byte.
    free_us: u64,
}

impl Line {
    /// A quiet line; `seed` fixes every random choice on it.
    pub fn new(spec: LinkSpec, seed: u64) -> Self {
        Line {
            spec,
            random: Pcg64Mcg::seed_from_u64(seed),
            flights: VecDeque::new(),
            held: None,
            free_us: 0,
        }
    }

    /// How long until everything put on the line so far has left; 0 when it is idle.
    pub fn backlog_us(&self, now_us: u64) -> u64 {
        self.free_us.saturating_sub(now_us)
    }

    /// When the last of its stalls and pulls is over.
    pub fn last_outage_end_us(&self) -> u64 {
        let outages = self.spec.stalls.iter().chain(&self.spec.pulls);
        outages.map(Outage::end_us).max().unwrap_or(0)
    }

    /// Puts a frame on the line.
    pub fn send(&mut self, now_us: u64, frame: &[u8]) {
        let mut frame = frame.to_vec();
        let lost = self.chance(self.spec.drop_per_frame);
        if self.chance(self.spec.truncate_per_frame) {
            frame.truncate(self.random.random_range(0..frame.len().max(1)));
        }
        if self.spec.flip_per_byte > 0.0 {
            for byte in &mut frame {
                if self.random.random_bool(self.spec.flip_per_byte) {
                    *byte ^= 1 << self.random.random_range(0..8);
                }
            }
        }
        let twice = self.chance(self.spec.dup_per_frame);
        if lost {
            // It still takes its time on the line.
            self.occupy(now_us, frame.len());
            return;
        }
        if self.held.is_none() && self.chance(self.spec.reorder_per_frame) {
            self.held = Some(frame);
            return;
        }
        if twice {
            self.put(now_us, frame.clone());
        }
        self.put(now_us, frame);
        if let Some(held) = self.held.take() {
            self.put(now_us, held);
        }
    }

    /// Appends to `out` the bytes that have arrived by now.
    pub fn receive(&mut self, now_us: u64, out: &mut Vec<u8>) {
        while let Some(mut flight) = self.flights.pop_front() {
            while let Some(&byte) = flight.bytes.get(flight.next) {
                let sent_us = flight.sent_us + self.byte_time_us(flight.next + 1);
                if sent_us + self.spec.delay_us > now_us {
                    self.flights.push_front(flight);
                    return;
                }
                if !self.spec.pulls.iter().any(|pull| pull.covers(sent_us)) {
                    out.push(byte);
                }
                flight.next += 1;
            }
        }
    }

    fn put(&mut self, now_us: u64, bytes: Vec<u8>) {
        let sent_us = self.occupy(now_us, bytes.len());
        self.flights.push_back(Flight {
            sent_us,
            next: 0,
            bytes,
        });
    }

    /// Reserves the line's time for this many bytes and returns when they begin to leave.
    fn occupy(&mut self, now_us: u64, bytes: usize) -> u64 {
        let mut start_us = self.free_us.max(now_us);
        let stalls = &self.spec.stalls;
        while let Some(stall) = stalls.iter().find(|stall| stall.covers(start_us)) {
            start_us = stall.end_us();
        }
        self.free_us = start_us + self.byte_time_us(bytes);
        start_us
    }

    fn byte_time_us(&self, bytes: usize) -> u64 {
        (bytes as u64 * BITS_PER_BYTE * 1_000_000).div_ceil(self.spec.baud)
    }

    fn chance(&mut self, probability: f64) -> bool {
        // A fault that is off draws nothing, so that it does not shift the others' draws.
        probability > 0.0 && self.random.random_bool(probability)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_of_the_specification_is_read() {
        let spec: LinkSpec =
            "drop=0.01,flip=1e-5,stall=2s@5s, pull=1.5ms@0s,delay=300us,baud=115200"
                .parse()
                .unwrap();
        assert_eq!(spec.drop_per_frame, 0.01);
        assert_eq!(spec.flip_per_byte, 1e-5);
        assert_eq!(spec.delay_us, 300);
        assert_eq!(spec.baud, 115_200);
        let outage = |start_us, length_us| Outage {
            start_us,
            length_us,
        };
        assert_eq!(spec.stalls, [outage(5_000_000, 2_000_000)]);
        assert_eq!(spec.pulls, [outage(0, 1500)]);
        assert_eq!("".parse::<LinkSpec>(), Ok(LinkSpec::default()));
    }

    #[test]
    fn wrong_texts_are_refused_with_their_place() {
        for (text, part) in [
            ("drop", "drop"),
            ("drop=2", "drop=2"),
            ("drop=nan", "drop=nan"),
            ("lose=1", "lose"),
            ("delay=3", "delay=3"),
            ("delay=infs", "delay=infs"),
            ("stall=2s", "stall=2s"),
            ("stall=2s@x", "stall=x"),
            ("baud=0", "baud=0"),
        ] {
            let error = text.parse::<LinkSpec>().unwrap_err();
            assert!(error.to_string().contains(part), "{text}: {error}");
        }
    }

    fn run(spec: LinkSpec, seed: u64, frames: usize) -> Vec<(u64, u8)> {
        let mut line = Line::new(spec, seed);
        for i in 0..frames {
            line.send(0, &[i as u8, 1, 0]);
        }
        let mut arrived = Vec::new();
        for now_us in 0..200_000 {
            let mut bytes = Vec::new();
            line.receive(now_us, &mut bytes);
            arrived.extend(bytes.into_iter().map(|byte| (now_us, byte)));
        }
        arrived
    }

    #[test]
    fn a_clean_line_carries_every_byte_in_its_time() {
        let arrived = run("baud=100000,delay=1ms".parse().unwrap(), 1, 10);
        let times: Vec<u64> = arrived.iter().map(|(time, _)| *time).collect();
        let expected: Vec<u64> = (1..=30).map(|i| 1000 + i * 100).collect();
        assert_eq!(times, expected);
    }

    #[test]
    fn a_stall_delays_and_a_pull_loses() {
        let clean = run("baud=100000".parse().unwrap(), 1, 10);
        let stalled = run("baud=100000,stall=50ms@1ms".parse().unwrap(), 1, 10);
        let bytes = |run: &[(u64, u8)]| run.iter().map(|(_, byte)| *byte).collect::<Vec<u8>>();
        assert_eq!(bytes(&clean), bytes(&stalled));
        assert!(stalled.last().unwrap().0 >= 51_000);
        let pulled = run("baud=100000,pull=1ms@1ms".parse().unwrap(), 1, 10);
        assert_eq!(pulled.len(), 20);
    }

    #[test]
    fn faults_come_at_their_rates_and_repeat_with_the_seed() {
        let spec: LinkSpec = "drop=0.2,baud=10000000".parse().unwrap();
        let arrived = run(spec.clone(), 7, 2000);
        let lost = 2000 - arrived.len() / 3;
        // Binomial, 18 a standard deviation.
        assert!((310..490).contains(&lost), "{lost}");
        assert_eq!(arrived, run(spec, 7, 2000));
        let doubled = run("dup=1,baud=10000000".parse().unwrap(), 7, 10);
        assert_eq!(doubled.len(), 60);
    }
}
