//! The fraction of work on photographs that were announced together.

/// Photographs that were announced together, or one that was not announced.
#[derive(Debug, Clone, Copy, Default)]
pub struct Group {
    /// Photographs accepted so far.
    accepted: usize,
    /// The accepted photographs on which the fit has settled.
    finished: usize,
    /// Announced photographs that are still to be added.
    to_come: usize,
    /// Fraction of the fit's work that is done since it last settled.
    share: f32,
    /// The fraction reported last, which never falls within a group.
    reported: f32,
}

impl Group {
    /// Starts again with photographs of a restored session, or after a removal: together they count as one.
    pub fn anew(&mut self, photographs: usize, share: f32) {
        let reported = if self.to_come > 0 { self.reported } else { 0.0 };
        let accepted = photographs.min(1);
        *self = Self { accepted, finished: 0, share, reported, ..*self };
    }

    /// Announces the number of photographs still to come. They join those on which the fit has not settled.
    pub fn announce(&mut self, photographs: usize, settled: bool) {
        if self.to_come == 0 && settled && photographs > 0 {
            *self = Self { share: self.share, ..Self::default() };
        }
        self.to_come = photographs;
    }

    /// A photograph was accepted. The fit has not received it yet.
    pub fn accept(&mut self) {
        if self.to_come == 0 {
            *self = Self::default();
        }
        self.to_come = self.to_come.saturating_sub(1);
        self.accepted += 1;
        self.share = 0.0;
    }

    /// A photograph was rejected.
    pub fn reject(&mut self) {
        self.to_come = self.to_come.saturating_sub(1);
    }

    /// Sets the fraction of the fit's work that is done.
    pub fn work(&mut self, share: f32) {
        self.share = share;
    }

    /// The fit has settled on all photographs but the latest `waiting`.
    pub fn settle(&mut self, waiting: usize) {
        self.finished = self.finished.max(self.accepted.saturating_sub(waiting));
    }

    /// Fraction of the work that is done. The fit's present work counts for all photographs since it last settled.
    pub fn fraction(&mut self) -> f32 {
        let all = self.accepted + self.to_come;
        let now = match all {
            0 => self.share,
            _ => {
                let begun = (self.accepted - self.finished) as f32;
                (self.finished as f32 + self.share * begun) / all as f32
            }
        };
        self.reported = self.reported.max(now);
        self.reported
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fractions when a photograph is accepted, when half of its work is done, and at the end.
    fn fit(group: &mut Group) -> [f32; 3] {
        group.accept();
        let accepted = group.fraction();
        group.work(0.5);
        let half = group.fraction();
        group.work(1.0);
        group.settle(0);
        [accepted, half, group.fraction()]
    }

    #[test]
    fn each_photograph_that_was_not_announced_begins_at_nothing() {
        let mut group = Group::default();
        assert_eq!(group.fraction(), 0.0);
        for _ in 0..3 {
            assert_eq!(fit(&mut group), [0.0, 0.5, 1.0]);
            group.reject();
            assert_eq!(group.fraction(), 1.0, "a rejection changes nothing");
        }
    }

    #[test]
    fn photographs_announced_together_are_one_piece_of_work() {
        let mut group = Group::default();
        fit(&mut group);
        group.announce(4, true);
        assert_eq!(group.fraction(), 0.0);
        assert_eq!(fit(&mut group), [0.0, 0.125, 0.25]);
        // One less: two are left.
        group.reject();
        assert_eq!(group.fraction(), 1.0 / 3.0);
        assert_eq!(fit(&mut group), [1.0 / 3.0, 0.5, 2.0 / 3.0]);
        // One that will not come after all.
        group.announce(0, true);
        assert_eq!(group.fraction(), 1.0);
        assert_eq!(fit(&mut group), [0.0, 0.5, 1.0], "one more");
    }

    #[test]
    fn photographs_that_come_before_the_fit_has_settled_never_take_anything_back() {
        let mut group = Group::default();
        group.announce(4, true);
        fit(&mut group);
        group.accept();
        group.work(0.8);
        let before = group.fraction();
        group.accept();
        assert_eq!(group.fraction(), before);
        // The fit ends before it has received the latest.
        group.settle(1);
        assert_eq!(group.fraction(), 0.5);
        group.accept();
        group.work(0.25);
        assert_eq!(group.fraction(), (2.0 + 0.25 * 2.0) / 4.0);
        // More come while it works on the last.
        group.announce(12, false);
        assert_eq!(group.fraction(), 0.625);
        group.work(1.0);
        group.settle(0);
        assert_eq!(group.fraction(), 0.625, "4 of 16");
        group.announce(0, true);
        assert_eq!(group.fraction(), 1.0);
    }

    #[test]
    fn a_group_of_rejected_photographs_leaves_what_was_done() {
        let mut group = Group::default();
        fit(&mut group);
        group.announce(1, true);
        assert_eq!(group.fraction(), 0.0);
        group.reject();
        assert_eq!(group.fraction(), 1.0);
    }

    #[test]
    fn work_that_begins_anew_takes_back_what_was_told_only_when_all_have_come() {
        let mut group = Group::default();
        group.announce(4, true);
        for _ in 0..2 {
            fit(&mut group);
        }
        group.anew(1, 0.0);
        assert_eq!(group.fraction(), 0.5);
        group.announce(0, true);
        group.anew(1, 0.0);
        assert_eq!(group.fraction(), 0.0);
        group.anew(0, 0.0);
        assert_eq!(group.fraction(), 0.0);
    }
}
