//! What is the shortest description of a state that was sampled at a steady rate?
//!
//! The spectral model of T-RO 2017 III-B (ICRA 2014): the N samples are Fourier transformed, the l
//! strongest of the N/2 rhythms are kept as triples of harmonic, amplitude and phase (the set P),
//! and the samples at which the thresholded p(t) is wrong as an [`OutlierSet`] (the set O).
//! Together they give every sample back:
//!
//! `s(t) = [p(t) >= 1/2] xor [t in O]` (eq. 7).
//!
//! # The numbers kept
//!
//! A triple is a harmonic (whole number), an amplitude in steps of 2^-15 and a phase in steps of
//! 2^-16 of a turn, 5 bytes for harmonics below 128. p(t) is *defined* by these whole numbers, by
//! additions and products alone, so the outlier set fits them on every platform and reconstruction
//! is exact there.
//!
//! # Cost
//!
//! Building: one real FFT of length N, `O(N log N)` with a factor for large prime factors of N (a
//! prime N costs about four times as much as its neighbours), and `O(N l)` products. A prediction:
//! O(l). Estimation error of an interval: from O alone, O(log) (eq. 15).
//!
//! Not for irregular sampling (see [`SpectralSums`](super::SpectralSums)): missing samples are
//! allowed, but every step of the clock counts.

use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};

use super::codec::{Reader, Writer};
use super::outliers::OutlierSet;
use super::phasor::unit;
use super::rhythms::Component;
use crate::error::{Error, ErrorKind, Result};
use crate::time::{Period, Time};

/// Steps of an amplitude in 1.
const AMPLITUDE_STEPS: f64 = 32_768.0;
/// Steps of a phase in a turn.
const PHASE_STEPS: f64 = 65_536.0;
/// Samples whose p is computed together.
const BLOCK: usize = 128;

/// One rhythm of the set P, as it is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Triple {
    /// Cycles in the transformed samples, at least 1.
    harmonic: u32,
    amplitude: u16,
    phase: u16,
}

impl Triple {
    /// Factors of `cos` and `sin` of the harmonic's angle.
    fn factors(self) -> (f64, f64) {
        let amplitude = f64::from(self.amplitude) / AMPLITUDE_STEPS;
        let (cos, sin) = unit(f64::from(self.phase) / PHASE_STEPS);
        (amplitude * cos, -amplitude * sin)
    }
}

/// What is written to a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// P and O: every sample can be given back.
    Lossless,
    /// P alone: as large for a year as for a day.
    Lossy,
}

/// A state sampled at `start`, `start + step`, ...: its strongest rhythms and where they are wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UniformSpectrum {
    start: Time,
    step: Period,
    /// Samples that P was learnt from: N.
    num_learnt: u64,
    /// Of these, how many were not missing, and how many of those 1.
    num_observed: u64,
    num_seen: u64,
    /// Samples so far, N and those added since.
    num_samples: u64,
    triples: Vec<Triple>,
    outliers: OutlierSet,
    missing: OutlierSet,
}

/// Learns series of one length, one after the other: plan and buffers are made once.
///
/// A plan costs as much as several transforms, and fresh buffers as much as one; many cells of a
/// grid, or many doors, share both. 24 N bytes for N samples and the plan's own tables.
pub struct UniformLearner {
    fft: Arc<dyn RealToComplex<f64>>,
    samples: Vec<f64>,
    spectrum: Vec<Complex<f64>>,
    scratch: Vec<Complex<f64>>,
}

impl std::fmt::Debug for UniformLearner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let num_samples = self.samples.len();
        write!(f, "UniformLearner({num_samples} samples)")
    }
}

impl UniformLearner {
    /// For series of `num_samples`.
    pub fn new(num_samples: usize) -> Result<Self> {
        if num_samples as u64 > UniformSpectrum::MAX_SAMPLES {
            return Err(too_long(num_samples as u64, 0));
        }
        let fft = RealFftPlanner::new().plan_fft_forward(num_samples);
        Ok(Self {
            samples: fft.make_input_vec(),
            spectrum: fft.make_output_vec(),
            scratch: fft.make_scratch_vec(),
            fft,
        })
    }

    /// What [`UniformSpectrum::build`] learns, bit for bit.
    pub fn build(
        &mut self,
        start: Time,
        step: Period,
        states: &[bool],
        order: usize,
    ) -> Result<UniformSpectrum> {
        let nothing = OutlierSet::default();
        UniformSpectrum::learn(start, step, states, nothing, order, Some(self))
    }

    /// What [`UniformSpectrum::build_with_missing`] learns, bit for bit.
    pub fn build_with_missing(
        &mut self,
        start: Time,
        step: Period,
        states: &[Option<bool>],
        order: usize,
    ) -> Result<UniformSpectrum> {
        let (states, missing) = split(states);
        UniformSpectrum::learn(start, step, &states, missing, order, Some(self))
    }

    /// The `order` strongest rhythms of the states, as harmonics with their coefficients.
    fn strongest(
        &mut self,
        states: &[bool],
        mean: f64,
        missing: &OutlierSet,
        order: usize,
    ) -> Result<Vec<(usize, Complex<f64>)>> {
        if states.len() != self.samples.len() {
            let planned = self.samples.len();
            return Err(Error::new(
                ErrorKind::Shape,
                format!("{} samples do not fit a plan for {planned}", states.len()),
            ));
        }
        let of_state = [0.0 - mean, 1.0 - mean];
        for (sample, &state) in self.samples.iter_mut().zip(states) {
            *sample = of_state[usize::from(state)];
        }
        for gap in missing.intervals() {
            self.samples[gap.start as usize..gap.end as usize].fill(0.0);
        }
        let (samples, spectrum) = (&mut self.samples, &mut self.spectrum);
        // The buffers are the plan's own sizes, the one thing that can be wrong here.
        (self
            .fft
            .process_with_scratch(samples, spectrum, &mut self.scratch))
        .map_err(|cause| Error::new(ErrorKind::Shape, cause.to_string()))?;
        let strongest = strongest_of_many(&self.spectrum, order).into_iter();
        Ok(strongest.map(|k| (k, self.spectrum[k])).collect())
    }
}

/// States with 0 where they are missing, and where that is.
fn split(states: &[Option<bool>]) -> (Vec<bool>, OutlierSet) {
    let mut missing = OutlierSet::default();
    for (index, _) in states.iter().enumerate().filter(|(_, s)| s.is_none()) {
        missing.push(index as u64);
    }
    (states.iter().map(|s| s.unwrap_or(false)).collect(), missing)
}

fn too_long(num_samples: u64, order: usize) -> Error {
    Error::new(
        ErrorKind::Shape,
        format!("{num_samples} samples with {order} rhythms are too many"),
    )
}

impl UniformSpectrum {
    const TAG: [u8; 4] = *b"CUS\x01";

    /// The longest series: 2^28 samples (its transform needs 4 GiB).
    pub const MAX_SAMPLES: u64 = 1 << 28;

    /// The most rhythms a model keeps.
    pub const MAX_ORDER: usize = 65_535;

    /// Learns a series of 0 and 1 with the `order` strongest rhythms.
    pub fn build(start: Time, step: Period, states: &[bool], order: usize) -> Result<Self> {
        Self::learn(start, step, states, OutlierSet::default(), order, None)
    }

    /// Learns a series in which some samples are missing (`None`): the transform sees the mean
    /// there (so that g is the balanced sum over the others) and they are no outliers.
    pub fn build_with_missing(
        start: Time,
        step: Period,
        states: &[Option<bool>],
        order: usize,
    ) -> Result<Self> {
        let (states, missing) = split(states);
        Self::learn(start, step, &states, missing, order, None)
    }

    fn learn(
        start: Time,
        step: Period,
        states: &[bool],
        missing: OutlierSet,
        order: usize,
        learner: Option<&mut UniformLearner>,
    ) -> Result<Self> {
        let num_samples = states.len() as u64;
        if num_samples > Self::MAX_SAMPLES || order > Self::MAX_ORDER {
            return Err(too_long(num_samples, order));
        }
        let num_observed = num_samples - missing.measure(0, num_samples);
        let num_seen = states.iter().filter(|&&state| state).count() as u64;
        let mut model = Self {
            start,
            step,
            num_learnt: num_samples,
            num_observed,
            num_seen,
            num_samples,
            triples: Vec::new(),
            outliers: OutlierSet::default(),
            missing,
        };
        if order > 0 && num_seen > 0 && num_seen < num_observed {
            let (mean, missing) = (model.mean(), &model.missing);
            let strongest = match learner {
                Some(learner) => learner.strongest(states, mean, missing, order),
                None => UniformLearner::new(states.len())?.strongest(states, mean, missing, order),
            }?;
            model.triples = model.triples_of(&strongest);
        }
        model.find_outliers(states);
        Ok(model)
    }

    /// Coefficients of the transform as they are kept.
    fn triples_of(&self, strongest: &[(usize, Complex<f64>)]) -> Vec<Triple> {
        let scale = 2.0 / self.num_observed as f64;
        let triples = strongest.iter().filter_map(|&(harmonic, g)| {
            // The harmonic at half the sampling rate has no counterpart of negative frequency.
            let is_half = 2 * harmonic as u64 == self.num_learnt;
            let num_counterparts = if is_half { 0.5 } else { 1.0 };
            let amplitude = (num_counterparts * scale * g.norm() * AMPLITUDE_STEPS).round();
            let phase = (g.arg() / std::f64::consts::TAU * PHASE_STEPS).round();
            (amplitude >= 1.0).then_some(Triple {
                harmonic: harmonic as u32,
                amplitude: amplitude.min(f64::from(u16::MAX)) as u16,
                phase: (phase as i64).rem_euclid(PHASE_STEPS as i64) as u16,
            })
        });
        triples.collect()
    }

    fn find_outliers(&mut self, states: &[bool]) {
        let mut outliers = OutlierSet::default();
        self.for_each_block(0..self.num_samples, |first, p| {
            let states = &states[first as usize..][..p.len()];
            let is_wrong = |(p, state): (&f64, &bool)| (*p >= 0.5) != *state;
            let num_wrong: usize = (p.iter().zip(states))
                .map(|sample| usize::from(is_wrong(sample)))
                .sum();
            // Most blocks are right or wrong as a whole.
            if num_wrong == p.len() {
                outliers.push_interval(first, first + p.len() as u64);
            } else if num_wrong > 0 {
                for (index, sample) in (first..).zip(p.iter().zip(states)) {
                    if is_wrong(sample) {
                        outliers.push(index);
                    }
                }
            }
        });
        self.outliers = if self.missing.limits().is_empty() {
            outliers
        } else {
            let mut observed = OutlierSet::default();
            for index in outliers.intervals().flatten() {
                if !self.missing.contains(index) {
                    observed.push(index);
                }
            }
            observed
        };
    }

    /// The mean of the observed samples that P was learnt from; 1/2 without any.
    pub fn mean(&self) -> f64 {
        if self.num_observed == 0 {
            super::P_UNKNOWN
        } else {
            self.num_seen as f64 / self.num_observed as f64
        }
    }

    /// The time of the first sample.
    pub fn start(&self) -> Time {
        self.start
    }

    /// The time between samples.
    pub fn step(&self) -> Period {
        self.step
    }

    /// Samples so far.
    pub fn num_samples(&self) -> u64 {
        self.num_samples
    }

    /// Samples that the rhythms were learnt from: those until the last update.
    pub fn num_learnt(&self) -> u64 {
        self.num_learnt
    }

    /// How many rhythms are kept.
    pub fn order(&self) -> usize {
        self.triples.len()
    }

    /// The set O.
    pub fn outliers(&self) -> &OutlierSet {
        &self.outliers
    }

    /// The samples that were missing.
    pub fn missing(&self) -> &OutlierSet {
        &self.missing
    }

    /// The set P, strongest first, with phases relative to the Unix epoch.
    pub fn components(&self) -> impl Iterator<Item = Component> + '_ {
        self.triples.iter().map(|triple| {
            let cycle_us = self.num_learnt as f64 * self.step.as_us() as f64;
            let cycles = -(self.start.as_us() as f64) / cycle_us * f64::from(triple.harmonic);
            let turns = f64::from(triple.phase) / PHASE_STEPS + cycles;
            Component {
                period_s: cycle_us / f64::from(triple.harmonic) / 1e6,
                amplitude: f64::from(triple.amplitude) / AMPLITUDE_STEPS,
                phase_rad: (turns - turns.round()) * std::f64::consts::TAU,
            }
        })
    }

    /// p at `offset_us` from the start.
    fn p_at_us(&self, offset_us: i128) -> f64 {
        let cycle_us = i128::from(self.num_learnt.max(1)) * i128::from(self.step.as_us());
        let offset_us = offset_us.rem_euclid(cycle_us);
        let mut p = self.mean();
        for triple in &self.triples {
            let (re, im) = triple.factors();
            let turns_us = offset_us * i128::from(triple.harmonic);
            // A division of 128 bits costs more than all the rest.
            let turn_us = match (u64::try_from(turns_us), u64::try_from(cycle_us)) {
                (Ok(turns_us), Ok(cycle_us)) => (turns_us % cycle_us) as f64,
                _ => (turns_us % cycle_us) as f64,
            };
            let (cos, sin) = unit(turn_us / cycle_us as f64);
            p += re * cos + im * sin;
        }
        p.clamp(0.0, 1.0)
    }

    /// p(`time`) in [0, 1] for any time, on or between samples (T-RO eq. 10 with the factor 2).
    pub fn p(&self, time: Time) -> f64 {
        self.p_at_us(i128::from(time.as_us()) - i128::from(self.start.as_us()))
    }

    /// Calls `with` with every sample's index and p, unclamped.
    fn for_each_p(&self, samples: std::ops::Range<u64>, mut with: impl FnMut(u64, f64)) {
        self.for_each_block(samples, |first, p| {
            for (index, &p) in (first..).zip(p) {
                with(index, p);
            }
        });
    }

    /// Calls `with` with an index and the unclamped p from there on, in blocks that share their
    /// phasors.
    fn for_each_block(&self, samples: std::ops::Range<u64>, mut with: impl FnMut(u64, &[f64])) {
        let len = self.num_learnt.max(1);
        // Within a block: cosines and sines of every harmonic at samples 0, 1, ... of the block.
        let mut tables = Vec::with_capacity(self.triples.len());
        for triple in &self.triples {
            let (mut cos, mut sin) = ([0.0; BLOCK], [0.0; BLOCK]);
            for (i, (cos, sin)) in cos.iter_mut().zip(&mut sin).enumerate() {
                let turn = i as u64 * u64::from(triple.harmonic) % len;
                (*cos, *sin) = unit(turn as f64 / len as f64);
            }
            tables.push((triple.harmonic, triple.factors(), cos, sin));
        }
        let mean = self.mean();
        // Blocks always begin at multiples of the block's length, so p has the same bits in any
        // range.
        let mut first = samples.start / BLOCK as u64 * BLOCK as u64;
        while first < samples.end {
            let mut p = [mean; BLOCK];
            for (harmonic, (re, im), cos_table, sin_table) in &tables {
                let turn = (first % len) * u64::from(*harmonic) % len;
                let (cos, sin) = unit(turn as f64 / len as f64);
                // The factors turned to the block's start.
                let (re, im) = (re * cos + im * sin, im * cos - re * sin);
                for ((p, cos), sin) in p.iter_mut().zip(cos_table).zip(sin_table) {
                    *p += re * cos + im * sin;
                }
            }
            let from = samples.start.max(first);
            let to = samples.end.min(first + BLOCK as u64);
            with(from, &p[(from - first) as usize..(to - first) as usize]);
            first += BLOCK as u64;
        }
    }

    /// The samples `range`, exactly as they were given; `None` where missing (eq. 7).
    ///
    /// # Panics
    /// If the range reaches beyond [`num_samples`](Self::num_samples).
    pub fn reconstruct(&self, range: std::ops::Range<u64>) -> Vec<Option<bool>> {
        assert!(range.end <= self.num_samples, "samples {range:?}");
        let mut states = Vec::with_capacity((range.end.saturating_sub(range.start)) as usize);
        let mut outliers = Membership::new(&self.outliers, range.start);
        let mut missing = Membership::new(&self.missing, range.start);
        self.for_each_p(range, |index, p| {
            let state = (p >= 0.5) ^ outliers.contains(index);
            states.push((!missing.contains(index)).then_some(state));
        });
        states
    }

    /// Adds the next sample (eq. 8); it changes P only at the next [`update`](Self::update).
    pub fn add(&mut self, state: Option<bool>) -> Result<()> {
        if self.num_samples == Self::MAX_SAMPLES {
            return Err(Error::new(
                ErrorKind::Shape,
                format!("a series has at most {} samples", Self::MAX_SAMPLES),
            ));
        }
        let index = self.num_samples;
        self.num_samples += 1;
        match state {
            None => self.missing.push(index),
            Some(state) => {
                let mut is_outlier = false;
                self.for_each_p(index..index + 1, |_, p| is_outlier = (p >= 0.5) != state);
                if is_outlier {
                    self.outliers.push(index);
                }
            }
        }
        Ok(())
    }

    /// Learns P again from all samples so far, with a new order; no sample is lost.
    pub fn update(&mut self, order: usize) -> Result<()> {
        let states = self.reconstruct(0..self.num_samples);
        let missing = std::mem::take(&mut self.missing);
        let states: Vec<_> = states.into_iter().map(|s| s.unwrap_or(false)).collect();
        *self = Self::learn(self.start, self.step, &states, missing, order, None)?;
        Ok(())
    }

    /// Whether the state is 1 with confidence `c`: `p(time) >= c` (eq. 9).
    pub fn predict(&self, time: Time, c: f64) -> bool {
        self.p(time) >= c
    }

    /// Whether a measured state contradicts the model with confidence `c` in (1/2, 1] (T-RO V): 0
    /// where p >= c, or 1 where p < 1 - c.
    pub fn is_anomaly(&self, time: Time, state: bool, c: f64) -> bool {
        if state {
            !self.predict(time, 1.0 - c)
        } else {
            self.predict(time, c)
        }
    }

    /// The share of the samples `range` at which the thresholded p is wrong, from O alone (eq. 15);
    /// 0 where nothing was observed.
    pub fn estimation_error(&self, range: std::ops::Range<u64>) -> f64 {
        let len = range.end.saturating_sub(range.start);
        let observed = len - self.missing.measure(range.start, range.end).min(len);
        if observed == 0 {
            return 0.0;
        }
        self.outliers.measure(range.start, range.end) as f64 / observed as f64
    }

    /// The estimation error over the samples added since the last update: how well P predicts.
    pub fn prediction_error(&self) -> f64 {
        self.estimation_error(self.num_learnt..self.num_samples)
    }

    /// The share of wrong states among `states` that begin at `start` and have this model's step.
    pub fn state_error(&self, start: Time, states: &[bool]) -> f64 {
        let mut offset_us = i128::from(start.as_us()) - i128::from(self.start.as_us());
        let mut wrong = 0;
        for &state in states {
            wrong += usize::from((self.p_at_us(offset_us) >= 0.5) != state);
            offset_us += i128::from(self.step.as_us());
        }
        wrong as f64 / states.len().max(1) as f64
    }

    /// The order from 0 to `max_order` whose rhythms, learnt from the samples until the last
    /// update, best predict the samples added since (T-RO IV-B); the lower one of equals, 0 without
    /// new samples.
    pub fn best_order(&self, max_order: usize) -> Result<usize> {
        let mut learnt = self.clone();
        learnt.outliers = OutlierSet::default();
        learnt.num_samples = self.num_learnt;
        let states = self.reconstruct(0..self.num_samples);
        let old = &states[..self.num_learnt as usize];
        let full = Self::build_with_missing(self.start, self.step, old, max_order)?;
        let mut best = (usize::MAX, 0);
        for order in 0..=full.order() {
            learnt.triples = full.triples[..order].to_vec();
            let mut wrong = 0;
            learnt.for_each_p(self.num_learnt..self.num_samples, |index, p| {
                wrong += usize::from(states[index as usize].is_some_and(|s| s != (p >= 0.5)));
            });
            if wrong < best.0 {
                best = (wrong, order);
            }
        }
        Ok(best.1)
    }

    /// One bit a sample over the bits of the encoded model (eq. 16).
    pub fn compression_ratio(&self, encoding: Encoding) -> f64 {
        self.num_samples as f64 / (8 * self.to_bytes(encoding).len()) as f64
    }

    /// The model as bytes with a checksum.
    pub fn to_bytes(&self, encoding: Encoding) -> Vec<u8> {
        let mut writer = Writer::new(Self::TAG);
        writer.signed(self.start.as_us());
        writer.varint(self.step.as_us() as u64);
        writer.varint(self.num_learnt);
        writer.varint(self.num_learnt - self.num_observed);
        writer.varint(self.num_seen);
        writer.varint(self.triples.len() as u64);
        for triple in &self.triples {
            writer.varint(triple.harmonic.into());
            writer.u16(triple.amplitude);
            writer.u16(triple.phase);
        }
        if encoding == Encoding::Lossless {
            writer.varint(self.num_samples - self.num_learnt);
            self.outliers.write(&mut writer);
            self.missing.write(&mut writer);
        }
        writer.finish()
    }

    /// What [`to_bytes`](Self::to_bytes) wrote. A lossy model has no samples: it predicts, but
    /// reconstructs nothing.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let mut reader = Reader::new(bytes, Self::TAG, "a spectral model")?;
        let start = Time::from_us(reader.signed()?);
        let step = Period::from_us(reader.varint()? as i64)?;
        let num_learnt = reader.varint()?;
        let num_missing = reader.varint()?;
        let num_seen = reader.varint()?;
        if num_learnt > Self::MAX_SAMPLES
            || num_missing > num_learnt
            || num_seen > num_learnt - num_missing
        {
            return Err(reader.impossible("impossible numbers of samples"));
        }
        let order = reader.varint()?;
        if order > Self::MAX_ORDER as u64 {
            return Err(reader.impossible("too many rhythms"));
        }
        let mut triples = Vec::new();
        for _ in 0..order {
            let harmonic = reader.varint()?;
            if harmonic == 0 || harmonic > num_learnt / 2 {
                return Err(reader.impossible("no such harmonic"));
            }
            triples.push(Triple {
                harmonic: harmonic as u32,
                amplitude: reader.u16()?,
                phase: reader.u16()?,
            });
        }
        let mut model = Self {
            start,
            step,
            num_learnt,
            num_observed: num_learnt - num_missing,
            num_seen,
            num_samples: 0,
            triples,
            outliers: OutlierSet::default(),
            missing: OutlierSet::default(),
        };
        if !reader.rest().is_empty() {
            model.num_samples = num_learnt.saturating_add(reader.varint()?);
            if model.num_samples > Self::MAX_SAMPLES {
                return Err(reader.impossible("impossible numbers of samples"));
            }
            model.outliers = OutlierSet::read(&mut reader, model.num_samples)?;
            model.missing = OutlierSet::read(&mut reader, model.num_samples)?;
            let mut outliers = model.outliers.intervals();
            if outliers.any(|outlier| model.missing.measure(outlier.start, outlier.end) > 0) {
                return Err(reader.impossible("a missing sample is an outlier"));
            }
            if model.missing.measure(0, num_learnt) != num_missing {
                return Err(reader.impossible("impossible numbers of missing samples"));
            }
        }
        reader.finish()?;
        Ok(model)
    }
}

/// Membership of ascending indices in O(1) each.
struct Membership<'a> {
    limits: &'a [u64],
    next: usize,
}

impl<'a> Membership<'a> {
    fn new(set: &'a OutlierSet, from: u64) -> Self {
        let limits = set.limits();
        let next = limits.partition_point(|&limit| limit <= from);
        Self { limits, next }
    }

    fn contains(&mut self, index: u64) -> bool {
        while self
            .limits
            .get(self.next)
            .is_some_and(|&limit| limit <= index)
        {
            self.next += 1;
        }
        self.next % 2 == 1
    }
}

/// The harmonics from 1 of the largest powers, strongest first, the lower of equals: O(N + n log n)
/// where n is the number requested.
fn strongest_of_many(spectrum: &[Complex<f64>], count: usize) -> Vec<usize> {
    let stronger = |a: &(f64, usize), b: &(f64, usize)| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1));
    let mut best: Vec<(f64, usize)> = Vec::with_capacity(2 * count + 64);
    let mut to_beat = f64::NEG_INFINITY;
    for (harmonic, g) in spectrum.iter().enumerate().skip(1) {
        let power = g.norm_sqr();
        if power <= to_beat {
            continue;
        }
        best.push((power, harmonic));
        if best.len() == best.capacity() {
            best.select_nth_unstable_by(count, stronger);
            best.truncate(count);
            let weakest = best.iter().map(|strong| strong.0);
            to_beat = weakest.fold(f64::INFINITY, f64::min);
        }
    }
    best.sort_unstable_by(stronger);
    best.truncate(count);
    best.into_iter().map(|(_, harmonic)| harmonic).collect()
}
