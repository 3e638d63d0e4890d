//! The runs of all buses whose exchanges are matched in their messages (`messages`). One is at hand; where another bus goes on, it is
//! set aside, so that interleaved connections need not begin a run for each exchange. Nothing is undecided on the bus of a run that
//! is set aside: it is brought up to date before anything else is done there, or at the end of the block.

use crate::session::exchanges::message_run::MessageRun;
use crate::session::exchanges::run::Form;
use modlens_protocol::Ns;

/// These runs.
#[derive(Default)]
pub(crate) struct MessageRuns {
    /// That of the bus that was heard last, whose request may be pending.
    pub(super) at_hand: Option<Box<MessageRun>>,
    /// Others, none with a pending request.
    aside: Vec<Box<MessageRun>>,
    /// For each bus, the place of its run there plus one, or 0.
    places: Vec<u32>,
}

impl MessageRuns {
    /// Makes the run of this bus that at hand, if it has one. The one before is set aside, or returned if its pending request has no
    /// response yet: it has to end, since others come after it.
    #[inline]
    pub(super) fn turn_to(&mut self, bus: usize) -> Option<Box<MessageRun>> {
        if self.at_hand.as_ref().is_some_and(|run| run.bus == bus) {
            return None;
        }
        let before = self.at_hand.take();
        self.at_hand = self.take_aside(bus);
        let run = before?;
        if !run.request.is_none() {
            return Some(run);
        }
        if self.places.len() <= run.bus {
            self.places.resize(run.bus + 1, 0);
        }
        self.places[run.bus] = self.aside.len() as u32 + 1;
        self.aside.push(run);
        None
    }

    /// Turns to this bus if no request is pending; returns whether its packets may be matched in pairs (`match_pairs`): it has a run,
    /// and its exchanges are compact.
    #[inline]
    pub(crate) fn turn_to_pairs(&mut self, bus: usize) -> bool {
        if self.at_hand.as_ref().is_some_and(|run| !run.request.is_none()) {
            return false;
        }
        self.turn_to(bus);
        self.at_hand.as_ref().is_some_and(|run| run.is_connection && run.run.form == Form::Compact)
    }

    #[inline]
    fn take_aside(&mut self, bus: usize) -> Option<Box<MessageRun>> {
        let place = std::mem::take(self.places.get_mut(bus)?).checked_sub(1)?;
        let run = self.aside.swap_remove(place as usize);
        if let Some(moved) = self.aside.get(place as usize) {
            self.places[moved.bus] = place + 1;
        }
        Some(run)
    }

    /// Takes a run that has to end before this bus, or without one any, is brought up to date: its own, or one with a pending request.
    #[inline]
    pub(super) fn take(&mut self, bus: Option<usize>) -> Option<Box<MessageRun>> {
        let ends = |run: &MessageRun| bus.is_none_or(|bus| run.bus == bus) || !run.request.is_none();
        let aside = bus.or_else(|| Some(self.aside.last()?.bus));
        aside.and_then(|bus| self.take_aside(bus)).or_else(|| self.at_hand.take_if(|run| ends(run)))
    }

    /// Returns whether the pending request may be given up by now.
    pub(crate) fn is_due(&self, now: Ns) -> bool {
        self.at_hand.as_ref().is_some_and(|run| run.is_due(now))
    }
}
