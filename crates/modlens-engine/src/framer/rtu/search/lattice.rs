//! The lattice: paths of frame hypotheses through the bytes, as a tree whose root is the frame committed last.
//!
//! A path is a chain of hypotheses from the root on. Its score is the sum of the scores of its frames, less the cost of the
//! bytes between them. Paths that fall too far after the best one are dropped, as in a beam search.

use crate::framer::rtu::search::commit::Decision;
use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::search::state::Search;
use crate::rtu_model::crc_scan::MAX_CANDIDATE_SPAN;
use crate::rtu_model::traffic_model::TrafficModel;
use crate::weights::{
    BEAM_BITS, BEAM_HYPOTHESES, BEAM_IN_NOISE_BITS, MIN_DAMAGED_FRAME_BYTES, UNANSWERED_BITS, UNFRAMED_PIECE_BYTES,
};

/// The score in bits below which a new hypothesis is not added while there is none but the root (`Search::beam_floor`), once the
/// bytes up to stream offset `scanned_to` are scanned.
pub(super) fn root_floor(model: &TrafficModel, root: &Hypothesis, scanned_to: u64) -> f32 {
    root.path_score - model.open_unframed_cost(scanned_to - root.end) - BEAM_IN_NOISE_BITS
}

/// The stream offset before which nothing is decided after a root that ends at `root_end` while there is no hypothesis: any
/// later byte may belong to a frame that begins in the first unframed bytes.
pub(super) fn first_decision_behind(root_end: u64) -> u64 {
    root_end + UNFRAMED_PIECE_BYTES + MAX_CANDIDATE_SPAN + 1
}

impl Search {
    /// The score in bits of the path that ends with this hypothesis, as it is at the last byte scanned: less the cost of
    /// the bytes after the frame.
    pub(super) fn current_score(&self, hypothesis: &Hypothesis) -> f32 {
        hypothesis.path_score - self.model.open_unframed_cost(self.scanned_to - hypothesis.end)
    }

    /// The last hypothesis of the path with the best score now, and that score.
    pub(super) fn best_path(&self) -> (usize, f32) {
        let scores = self.lattice.iter().enumerate().map(|(i, hypothesis)| (i, self.current_score(hypothesis)));
        scores.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((ROOT, 0.0))
    }

    /// The same where nothing follows for some time. A path that ends with a write again, which was just answered, pays for the
    /// silence: the unit that has answered would do it again, so that frame was rather the response.
    pub(super) fn best_path_before_silence(&self) -> (usize, f32) {
        let scores = self.lattice.iter().map(|hypothesis| self.score_before_silence(hypothesis)).enumerate();
        scores.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((ROOT, 0.0))
    }

    /// The score of a path, as `best_path_before_silence` compares them.
    pub(super) fn score_before_silence(&self, hypothesis: &Hypothesis) -> f32 {
        let requests = self.requests.look_up(hypothesis.answerable);
        let is_again = requests
            .outstanding
            .zip(requests.last_answered)
            .is_some_and(|(request, (answered, _))| (request.unit, &request.pdu) == (answered.unit, &answered.pdu));
        self.current_score(hypothesis) - if is_again { UNANSWERED_BITS } else { 0.0 }
    }

    /// The score in bits below which a new hypothesis is not added.
    pub(super) fn beam_floor(&self) -> f32 {
        if let [root] = &self.lattice[..] {
            return root_floor(&self.model, root, self.scanned_to);
        }
        let (best, score) = self.best_path();
        score - if self.lattice[best].first_on_path == ROOT { BEAM_IN_NOISE_BITS } else { BEAM_BITS }
    }

    /// Drops all but the best `BEAM_HYPOTHESES` within `BEAM_BITS` of the best path, the frames on the way to them, and the root:
    /// crafted bytes and some noise make hypotheses without end. What was known in advance is void then.
    pub(super) fn prune(&mut self) {
        let mut order: Vec<usize> = (0..self.lattice.len()).collect();
        let scores: Vec<f32> = self.lattice.iter().map(|hypothesis| self.current_score(hypothesis)).collect();
        order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]).then(b.cmp(&a)));
        let floor = scores[order[0]] - BEAM_BITS;
        let mut keep = vec![false; self.lattice.len()];
        for &i in order.iter().take(BEAM_HYPOTHESES) {
            keep[i] = scores[i] >= floor;
        }
        keep[ROOT] = true;
        for i in (1..self.lattice.len()).rev() {
            let parent = self.lattice[i].parent;
            keep[parent] |= keep[i];
        }
        self.retain(&keep);
        self.update_after_new_root();
    }

    /// Keeps the marked hypotheses. With each of them its parent has to be marked.
    fn retain(&mut self, keep: &[bool]) {
        let mut new_indices = vec![0; self.lattice.len()];
        let mut kept = 0;
        for (index, &keep) in new_indices.iter_mut().zip(keep) {
            *index = kept;
            kept += usize::from(keep);
        }
        let mut i = 0;
        self.lattice.retain_mut(|hypothesis| {
            hypothesis.parent = new_indices[hypothesis.parent];
            i += 1;
            keep[i - 1]
        });
    }

    /// Moves the root to this offset: the bytes before it belong to no frame. Hypotheses after it stay.
    pub(super) fn commit_unframed(&mut self, to: u64) -> Decision {
        let mut index = 0;
        self.lattice.retain(|hypothesis| {
            index += 1;
            index == 1 || (hypothesis.parent == ROOT && hypothesis.start >= to)
        });
        (self.lattice[ROOT].start, self.lattice[ROOT].end) = (to, to);
        if self.scanned_to <= to {
            self.is_scanning = false;
        }
        self.update_after_new_root();
        Decision::UnframedTo(to)
    }

    /// Makes the hypothesis of this index the root, because it is committed. Those that do not follow it are dropped, path
    /// scores count from it on, and what was known in advance is void. `scanned_to` stays.
    pub(super) fn set_root(&mut self, new_root: usize) {
        let score = self.lattice[new_root].path_score;
        self.retain_behind(new_root);
        for hypothesis in &mut self.lattice {
            hypothesis.path_score -= score;
        }
        self.update_after_new_root();
    }

    /// Keeps this hypothesis, which becomes the root, and those on whose path it is. Parents are before their children.
    fn retain_behind(&mut self, first: usize) {
        const DROPPED: usize = usize::MAX;
        let mut new_indices = std::mem::take(&mut self.new_indices);
        new_indices.clear();
        new_indices.resize(self.lattice.len(), DROPPED);
        new_indices[first] = ROOT;
        self.lattice.swap(ROOT, first);
        self.lattice[ROOT].parent = ROOT;
        let mut kept = ROOT + 1;
        for i in first + 1..self.lattice.len() {
            let parent = new_indices[self.lattice[i].parent];
            if parent != DROPPED {
                (new_indices[i], self.lattice[i].parent) = (kept, parent);
                self.lattice.swap(kept, i);
                kept += 1;
            }
        }
        self.lattice.truncate(kept);
        self.new_indices = new_indices;
    }

    /// Computes again what depends on the root.
    fn update_after_new_root(&mut self) {
        let root_end = self.committed_offset();
        self.skip.forget_decisions(if self.lattice.len() == 1 { first_decision_behind(root_end) } else { 0 });
        self.lattice[ROOT].next_damaged_end_at = root_end + MIN_DAMAGED_FRAME_BYTES;
        self.skip.next_damaged_end_at = u64::MAX;
        for i in 0..self.lattice.len() {
            let parent = self.lattice[i].parent;
            let is_first = i != ROOT && parent == ROOT;
            self.lattice[i].first_on_path = if is_first { i } else { self.lattice[parent].first_on_path };
            self.skip.next_damaged_end_at = self.skip.next_damaged_end_at.min(self.lattice[i].next_damaged_end_at);
        }
        self.lattice[ROOT].first_on_path = ROOT;
    }
}
