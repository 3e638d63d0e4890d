//! The information content of bytes, what the line's noise teaches of it, and the cost of bytes between frames.

use crate::rtu_model::log2::log2;
use crate::rtu_model::traffic_model::TrafficModel;
use crate::weights;

/// From this many bytes on, four histograms are filled in turn: see `learn_noise`.
const MANY_BYTES: usize = 1024;

impl TrafficModel {
    /// The information content of a byte, in bits: less for values that this line's noise is made of.
    #[inline]
    pub fn bits(&self, byte: u8) -> f32 {
        self.bits[byte as usize]
    }

    /// The information content of some bytes, in bits.
    pub fn bits_of(&self, bytes: &[u8]) -> f32 {
        bytes.iter().map(|&byte| self.bits(byte)).sum()
    }

    /// Learns from bytes that belong to no frame: on a wrong baud rate or a floating line few values make all of the noise.
    ///
    /// It only counts them; `bits` follow once in `NOISE_UPDATE_BYTES`.
    pub fn learn_noise(&mut self, bytes: &[u8]) {
        let one_by_one = if bytes.len() >= MANY_BYTES { self.count_quads(bytes) } else { bytes };
        for &byte in one_by_one {
            self.noise[byte as usize] += 1.0;
        }
        self.noise_total += bytes.len() as f32;
        if self.noise_total >= self.noise_due {
            self.update_bits();
        }
    }

    /// Counts noise bytes by value, four at a time; returns the last ones, fewer than four, which are not counted.
    ///
    /// To count the same value twice in a row, the second addition would have to wait for the first. Four histograms, filled in
    /// turn, avoid that.
    fn count_quads<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        let mut histograms = [[0u32; 256]; 4];
        let quads = bytes.chunks_exact(4);
        let rest = quads.remainder();
        for quad in quads {
            for (histogram, &byte) in histograms.iter_mut().zip(quad) {
                histogram[usize::from(byte)] += 1;
            }
        }
        for (value, count) in self.noise.iter_mut().enumerate() {
            *count += histograms.iter().map(|histogram| histogram[value]).sum::<u32>() as f32;
        }
        rest
    }

    /// Computes the information content of all byte values again: a mixture of the usual shares and those of the noise, of which
    /// the latter weigh more with each noise byte. No value becomes rarer than usual. Old noise counts are halved.
    ///
    /// The loop has no branches, so the compiler turns it into a few vector operations.
    fn update_bits(&mut self) {
        if self.noise_total > weights::NOISE_HALVE_BYTES {
            self.noise.iter_mut().for_each(|count| *count /= 2.0);
            self.noise_total /= 2.0;
        }
        self.noise_due = self.noise_total + weights::NOISE_UPDATE_BYTES;
        let total = self.noise_total;
        let weight = total / (total + weights::NOISE_PRIOR_BYTES);
        for ((bits, &seen), &usual) in self.bits.iter_mut().zip(self.noise.iter()).zip(self.usual_shares.iter()) {
            *bits = -log2((1.0 - weight) * usual + weight * (seen / total).max(usual));
        }
    }

    /// Cost in bits of this many unframed bytes between two frames: the cheaper of a short run of stray bytes and noise.
    pub fn unframed_cost(&self, bytes: u64) -> f32 {
        if bytes == 0 {
            return self.adjacent_cost;
        }
        let stray_run =
            weights::ENTER_STRAY_RUN_BITS + weights::STRAY_BYTE_BITS * (bytes - 1) as f32 + weights::LEAVE_STRAY_RUN_BITS;
        self.separated_cost + stray_run.min(weights::ENTER_NOISE_BITS + weights::LEAVE_NOISE_BITS)
    }

    /// Cost in bits of this many unframed bytes after the last frame of a path while no frame follows yet.
    pub fn open_unframed_cost(&self, bytes: u64) -> f32 {
        if bytes == 0 {
            0.0
        } else {
            let stray_run = weights::ENTER_STRAY_RUN_BITS + weights::STRAY_BYTE_BITS * (bytes - 1) as f32;
            self.separated_cost + stray_run.min(weights::ENTER_NOISE_BITS)
        }
    }
}
