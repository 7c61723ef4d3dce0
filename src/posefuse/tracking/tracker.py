"""The tracker's loop: foresee, match, put right, live on or be lost, be born. See docs/methods.md, "People"."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from posefuse.arrays import frozen
from posefuse.errors import DetectionsError
from posefuse.kernels.tracking.frame_statistics import (
    assign_labels,
    clear_majority_swaps,
    record_matches,
    update_gated_time,
)
from posefuse.kernels.tracking.matching import match_views
from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import USED, State
from posefuse.kernels.tracking.update import update_people
from posefuse.model.frames import Frame
from posefuse.model.proposals import Proposals
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState
from posefuse.tracking import fast_motion, identity_audit, lifecycle, reinitialize
from posefuse.tracking.body_states import Sight, Uses, chosen, joined, nobody, put
from posefuse.tracking.camera_fit import Watch, look_at
from posefuse.tracking.frame_clock import SAME_S, Clock, moments
from posefuse.tracking.identity_audit import Contact
from posefuse.tracking.lifecycle import Bounds
from posefuse.tracking.missed_views import is_covered, silent_views
from posefuse.tracking.partial_detections import forget_swaps, hold_back, joined_pieces
from posefuse.tracking.parts import Bodies, PartFollower, sides_of, swap_sides
from posefuse.tracking.records import Evidence, Lately, People, Person, Remembered, Tentative, Track
from posefuse.tracking.reidentification import all_are_known
from posefuse.tracking.settings import Settings
from posefuse.tracking.silent_cameras import Silence, listen
from posefuse.tracking.single_view_height import keep_floor, note_floor
from posefuse.tracking.single_view_posture import keep_posture, note_posture
from posefuse.tracking.stages import Likeness, Seen, Stages
from posefuse.tracking.state_initiation import begin
from posefuse.tracking.strategies import stages_of
from posefuse.tracking.track_initiation import continue_with, evidence_of, is_believable, is_over

_LEAPT_ODDS = 2.0
"""Log odds that the sides of one who leapt are as a proposal has them."""

Propose = Callable[[Frame, np.ndarray], Proposals]
"""From a frame, and which of its rows are free, shape (row,), to people whom several views show."""


class ArticulatedTracker:
    """Follows people from one frame to the next; causal, and nothing is kept anywhere else.

    Args:
        settings: what it works with.
        propose: finds people among detections that are nobody's.
        stages: what presets differ in; those of the options' preset where they are left out.
    """

    def __init__(self, settings: Settings, propose: Propose, stages: Stages | None = None) -> None:
        self.stages = stages or stages_of(settings.options.preset)
        if not self.stages.prior.smoothable:
            settings = replace(settings, options=replace(settings.options, smoother="none"))
        self.settings = settings
        self.propose = propose
        self.tracks: list[Track] = []
        self.state = nobody(settings.tree)
        self.lately = self._unknown(0)
        self.tentative: list[Tentative] = []
        self.clock = Clock()
        self.names = 0
        self.guesses = 0
        self.remembered: dict[str, list[Remembered]] = {}
        """Of people first believed in the last frame: their states in the frames before."""
        self.events: list[Event] = []
        self.exchanged: list[tuple[tuple[int, int], float]] = []
        """Whose names, as was found in the last frame, belong to each other, by number, and since when."""
        self.innovations: dict[int, tuple[float, int]] = {}
        """By number, of those who were followed into the last frame: NIS and its degrees of freedom."""
        self.parts = tuple(PartFollower(part, settings) for part in settings.skeleton.parts)
        """Hands and faces; nothing of them goes back to the bodies."""
        self.sides = sides_of(self.parts, settings.skeleton.mirror)
        self.silence = Silence.over(len(settings.rig))
        self.watch = Watch.over(len(settings.rig))
        self.contacts: dict[tuple[str, str], Contact] = {}

    def update(self, frame: Frame) -> People:
        """Take a frame, later than the last; who is where.

        Raises:
            DetectionsError: if the frame does not fit the cameras or the skeleton, or is not later than the last.
        """
        self._check(frame)
        dt_s = self.clock.take(frame)
        self.events, self.exchanged, self.remembered = [], [], {}
        self.innovations = {}
        rows, used = self._follow(frame, dt_s)
        self._live_on(frame, rows, used, dt_s)
        self._tell_apart(frame, rows, dt_s)
        rows, used = self._bear(frame, rows, used, dt_s)
        sight = self._foreseen(self.settings.cameras if self.parts else self.settings.cameras[:0])
        if self.parts:
            self._follow_parts(frame, rows, used, sight, dt_s)
        return self._told(frame.number, rows, used, sight)

    @property
    def time_s(self) -> float:
        """Of the last frame, NaN before the first."""
        return self.clock.time_s

    def shape_of(self, p: int) -> tuple[np.ndarray, np.ndarray]:
        """The shape of a body and its standard deviations, shape (shape,) each, m."""
        tree, track = self.settings.tree, self.tracks[p]
        n, h = tree.n_pose, tree.n_shape
        block = track.trusted[1] if track.trusted else self.state.covariance[p, n : n + h, n : n + h]
        return self.state.shape[p].copy(), np.sqrt(np.diag(block))

    def _check(self, frame: Frame) -> None:
        views, keypoints = len(self.settings.rig), len(self.settings.skeleton)
        if len(frame.recorded) != views or (len(frame.view) and frame.keypoints_px.shape[1] != keypoints):
            raise DetectionsError(
                f"Frame {frame.number} has {len(frame.recorded)} views and {frame.keypoints_px.shape[1]} keypoints a "
                f"person; this tracker has {views} cameras and {keypoints} keypoints."
            )

    def _follow(self, frame: Frame, dt_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Foresee everybody, match detections, put states right: rows (track, view), used (track, view, keypoint)."""
        s, n = self.settings, len(self.tracks)
        views, keypoints = len(s.rig), len(s.skeleton)
        if not n:
            self.sight = Sight.room(0, views, keypoints)
            self.explained = np.zeros(len(frame.view), dtype=bool)
            self.supported = np.empty((0, views), dtype=bool)
            return np.empty((0, views), dtype=np.int64), np.empty((0, views, keypoints), dtype=bool)
        views_then = moments(frame, self.time_s)
        self.stages.prior.settle(self.state, self.lately)
        before = chosen(self.state, np.arange(n)) if len(views_then) > 1 else None
        self._move_on(self.state, dt_s)
        self.sight = self._foreseen(s.cameras)
        forget_swaps(self.lately.swapped, dt_s, s.options)
        rows, found = self._match(frame)
        self._let_leap(frame, rows, found, before, dt_s)
        lost = np.array([track.state == TrackState.LOST for track in self.tracks], dtype=bool)
        hold_back(rows, found.gain, lost, s.options)
        clear_majority_swaps(rows, found.swapped)
        frame = joined_pieces(frame, rows, found, s)
        labels = self.labels = self._labels(rows, found.swapped)
        record_matches(
            rows, found.swapped, found.swap_odds, frozen(frame.track_ids, np.int64), dt_s, self.lately.alone_s,
            self.lately.swapped, self.lately.ids,
        )  # fmt: skip
        alone = self.lately.alone_s > 0.0
        then = self.state if before is None else before
        keep_posture(then, self.lately, alone, dt_s, s)
        keep_floor(then, self.lately, alone, dt_s, s)
        self._begin_anew(frame, rows, before, dt_s)
        use = self._put_right(frame, rows, labels, before, dt_s)
        uses = Uses.of(use)
        self.supported = uses.of_view >= s.options.min_joints
        shown = self.supported.sum(axis=1)
        note_posture(self.state, self.lately, shown, dt_s)
        note_floor(self.sight, self.lately, shown, dt_s, s)
        self._set_limbs_anew(frame, rows, uses, dt_s)
        self.lately.renewed[:] = uses.of_view.any(axis=1)
        return rows, use == USED

    def _unknown(self, tracks: int) -> Lately:
        s = self.settings
        movers = len(s.tree.segments) + len(s.tree.bones)
        return Lately.unknown(tracks, len(s.rig), s.n_groups, len(s.skeleton), movers)

    def _move_on(self, state: State, dt_s: float) -> None:
        s = self.settings
        dt = np.full(len(state.root), max(dt_s, 0.0))
        predict_people(dt, s.decay_s, s.power, s.most, s.options.motion.shape_walk, state)

    def _begin_anew(self, frame: Frame, rows: np.ndarray, before: State | None, dt_s: float) -> None:
        """Begin where views show them with segments and bones of which nothing is known any more."""
        if not reinitialize.are_rare(dt_s, self.settings):
            return
        which = reinitialize.unknown(self.state, self.settings)
        for p in np.flatnonzero(which.any(axis=1) & ((rows >= 0).sum(axis=1) > 1)):
            points = self._points_shown(frame, rows[p])
            for state in (self.state,) if before is None else (self.state, before):
                reinitialize.begin_anew(state, int(p), which[p], points, self.settings)

    def _put_right(
        self, frame: Frame, rows: np.ndarray, labels: np.ndarray, before: State | None, dt_s: float
    ) -> np.ndarray:
        """Update all states; what became of each keypoint, shape (track, view, keypoint).

        Args:
            frame: what the views show.
            rows: shape (track, view).
            labels: shape (track, view, keypoint).
            before: states at the time of the last frame, if views differ in time.
            dt_s: since then.
        """
        s, n = self.settings, len(self.tracks)
        trust = self.stages.noise.trust(frame, rows, labels, self.lately, self.clock.apart_s, s)
        use, nis, surprise = np.empty((n, *labels.shape[1:]), dtype=np.int64), np.zeros(n), np.empty(n)

        def update(rows: np.ndarray, use: np.ndarray) -> None:
            update_people(
                s.cameras, s.body, trust.law, trust.temper, s.options.iterations, rows, labels, frame.keypoints_px,
                trust.confidence, self.state, use, np.empty(n), surprise,
            )  # fmt: skip
            nis[:] += surprise

        if before is None:
            update(rows, use)
            self._note_innovations(nis, use)
            return use
        self.state, now_s = before, self.time_s - dt_s
        for time_s, views in moments(frame, self.time_s):
            self._move_on(self.state, time_s - now_s)
            now_s = max(now_s, time_s)
            part = np.empty_like(use)
            update(np.where(views, rows, -1), part)
            use[:, views] = part[:, views]
        self._note_innovations(nis, use)
        return use

    def _note_innovations(self, nis: np.ndarray, use: np.ndarray) -> None:
        dof = 2 * (use == USED).sum(axis=(1, 2))
        found = zip(self.tracks, nis.tolist(), dof.tolist(), strict=True)
        self.innovations = {track.number: (total, count) for track, total, count in found if count}

    def _set_limbs_anew(self, frame: Frame, rows: np.ndarray, uses: Uses, dt_s: float) -> None:
        """Limbs that most views have seen elsewhere for some time are where those show them, and as good as unknown."""
        gated, off_s = uses.gated, self.lately.off_s
        if update_gated_time(uses.used, gated, dt_s, off_s) < self.settings.options.limb_anew_s:
            return
        for p in np.flatnonzero(off_s.max(axis=1) >= self.settings.options.limb_anew_s):
            k = int(off_s[p].argmax())
            off_s[p] = 0.0
            points = self._points_shown(frame, rows[p])
            if lifecycle.set_limb_anew(self.state, int(p), k, points, self.settings):
                name = self.settings.skeleton.keypoints[k]
                why = f"{gated[p, k]} cameras see the {name} elsewhere"
                self.events.append(Event(frame.number, self.time_s, self.tracks[p].name, "limb set anew", why))

    def _points_shown(self, frame: Frame, rows: np.ndarray) -> np.ndarray:
        """Shape (keypoint, 3): where the detections of one person, shape (view,), put their points by themselves."""
        mine = np.zeros(len(frame.view), dtype=bool)
        mine[rows[rows >= 0]] = True
        proposals = self.propose(frame, mine)
        if not len(proposals):
            return np.full((len(self.settings.skeleton), 3), np.nan)
        return proposals.points_m[int(proposals.n_views.argmax())]

    def _match(self, frame: Frame) -> tuple[np.ndarray, Likeness]:
        """Rows (track, view), and how well detections go with people."""
        s, views = self.settings, len(self.settings.rig)
        found = self.stages.score.match(self.sight, frame, self.lately, self.stages.noise, s)
        rows = np.empty((len(self.tracks), views), dtype=np.int64)
        match_views(found.gain, frame.view, views, found.least, rows)
        self.explained = found.explained
        return rows, found

    def _let_leap(self, frame: Frame, rows: np.ndarray, found: Likeness, before: State | None, dt_s: float) -> None:
        """Find those who are not where they were foretold but where they can have leapt, in place.

        Args:
            frame: the detections.
            rows: shape (track, view), in and out.
            found: how well detections go with people; in and out: whose sides are exchanged.
            before: states at the time of the last frame, if views differ in time; in and out.
            dt_s: since then.
        """
        s, nobodys = self.settings, self._free(frame, rows)
        if not nobodys.any():
            return
        of_view = np.bincount(frame.view[nobodys], minlength=len(s.rig)) > 0
        active = np.array([track.state == TrackState.ACTIVE for track in self.tracks], dtype=bool)
        who = fast_motion.may_have(rows, of_view, active)
        if not len(who):
            return
        nobodys[rows[who][rows[who] >= 0]] = True
        proposals = self.propose(frame, nobodys)
        gone_s = np.array([self.time_s - self.tracks[p].firm_s for p in who])
        for leap in fast_motion.leaps(who, rows, self.sight.points_m, gone_s, proposals, s):
            p = leap.place
            rows[p] = proposals.rows[leap.proposal]
            for v in np.flatnonzero(rows[p] >= 0):
                sides = proposals.swapped[leap.proposal, v]
                found.swapped[p, rows[p, v]] = sides
                found.swap_odds[p, rows[p, v]] = _LEAPT_ODDS if sides else -_LEAPT_ODDS
            put(self.state, p, fast_motion.leapt(self.state, leap, dt_s, s))
            if before is not None:
                put(before, p, fast_motion.leapt(before, leap, 0.0, s))

    def _labels(self, rows: np.ndarray, swapped: np.ndarray) -> np.ndarray:
        """Which of a detection's keypoints is the body's, shape (track, view, keypoint)."""
        s = self.settings
        labels = np.empty((*rows.shape, len(s.skeleton)), dtype=np.int64)
        assign_labels(rows, swapped, s.group_of, s.skeleton.mirror, labels)
        return labels

    def _live_on(self, frame: Frame, rows: np.ndarray, used: np.ndarray, dt_s: float) -> None:
        """Who is supported, who is lost, who is forgotten."""
        stages, supported = self.stages, self.supported
        should_see, torsos = lifecycle.expected(self.sight, self.settings)
        self.expected = should_see & frame.recorded
        expected = self.expected & ~self.watch.refused
        scores, bounds = np.empty(0), self._bounds()
        for p, track in enumerate(self.tracks):
            if not track.sure:
                expected[p] &= ~is_covered(self.sight.pixels[p][:, self.settings.core], rows[p], frame)
        if self.tracks:
            seen = Seen(frame, self.time_s, dt_s, rows, self.labels, used, supported, expected)
            stages.noise.learn(seen, self.lately, self.state, self.settings)
            scores = stages.score.active(seen, self.tracks, self.state, self.settings)
        for p, track in enumerate(self.tracks):
            said = lifecycle.live_on(
                track, float(scores[p]), bounds, supported[p], expected[p], torsos[p], self.time_s,
                self.settings,
            )  # fmt: skip
            self.events.extend(Event(frame.number, self.time_s, track.name, what, why) for what, why in said)
            lifecycle.settle_shape(track, self.state, p, self.time_s, dt_s, self.settings)
        if self.settings.options.outside_s is not None:
            lifecycle.note_inside(self.tracks, self.sight, self.time_s, self.settings)
        over = lifecycle.forgotten(self.tracks, self.state, self.time_s, self.settings)
        for p, why in over.items():
            self.events.append(Event(frame.number, self.time_s, self.tracks[p].name, "forgotten", why))
        if over:
            keep = [p for p in range(len(self.tracks)) if p not in over]
            self.tracks = [self.tracks[p] for p in keep]
            self.state, self.lately = chosen(self.state, keep), self.lately.chosen(keep)
            self._keep = keep
        else:
            self._keep = list(range(len(self.tracks)))

    def _bear(self, frame: Frame, rows: np.ndarray, used: np.ndarray, dt_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Who is new: proposals from free detections, tentative people, and those of them who are believed now."""
        s, stages = self.settings, self.stages
        rows, used = rows[self._keep], used[self._keep]
        free, held = self._free(frame, rows), self._held_by_one_view(rows)
        free[list(held)] = True
        found = self._found(frame, free)
        new = continue_with(self.tentative, found, lambda last, new: stages.distance.apart(last, new, s))
        for each in new:
            self.guesses += 1
            self.tentative.append(Tentative(self.guesses, [each]))
        staying = []
        for each in self.tentative:
            each.score = stages.score.tentative(each, self.time_s, dt_s, s)
            waits_s = stages.score.waits_s(each, s)
            if is_believable(each, self.time_s, stages.score.promotes_from(s), waits_s, s):
                born = self._believe(each, frame.number, held)
                if born is not None:
                    p, counted = born
                    if p < len(rows):
                        rows[p], used[p] = each.evidence[-1].rows, counted
                    else:
                        rows, used = np.vstack([rows, each.evidence[-1].rows]), np.vstack([used, counted[None]])
                    continue
            if not is_over(each, self.time_s, waits_s, s):
                staying.append(each)
        self.tentative = staying
        return rows, used

    def _held_by_one_view(self, rows: np.ndarray) -> dict[int, int]:
        """Detections to the people whom nothing else has shown for some time, by place.

        How far away those are is hardly known. Where others see the person of that detection elsewhere, they are there.
        """
        held = {}
        for p, track in enumerate(self.tracks):
            if self.time_s - track.firm_s > self.settings.options.weak_after_s + SAME_S:
                mine = rows[p][rows[p] >= 0]
                if len(mine) == 1:
                    held[int(mine[0])] = p
        return held

    def _tell_apart(self, frame: Frame, rows: np.ndarray, dt_s: float) -> None:
        """Which cameras still stand where they stood, and who is who after people were too near to tell."""
        n, number = len(self.settings.rig), frame.number
        active = np.array([track.state == TrackState.ACTIVE for track in self.tracks], dtype=bool)
        keep = self._keep
        supported, expected = self.supported[keep], self.expected[keep]
        free = np.bincount(frame.view[self._free(frame, rows[keep], whole=True)], minlength=n)
        for v, refused, why in look_at(self.watch, supported[active], expected[active], free, dt_s):
            what = "camera refused" if refused else "camera trusted"
            self.events.append(Event(number, self.time_s, self.settings.rig.names[v], what, why))
        self._listen(frame, dt_s)
        scale = self.settings.tree.scale
        identity_audit.contacts(self.contacts, self.tracks, self.state, supported, expected, self.time_s, dt_s, scale)
        if self.contacts:
            sight = self._foreseen(self.settings.cameras[:0])
            for p, track in enumerate(self.tracks):
                if supported[p].sum() > 1:
                    identity_audit.remember(self.contacts, track.name, self._shown(frame, rows[keep][p], p, sight))
            renamed: set[str] = set()
            for finding in identity_audit.audit(self.contacts, self.tracks, self.state, self.time_s, self.settings):
                if not renamed & set(finding.names):
                    self._conclude(finding, number)
                    renamed |= set(finding.names) if finding.exchange else set()

    def _listen(self, frame: Frame, dt_s: float) -> None:
        """Which cameras say nothing any more, or again."""
        for v, silent, why in listen(self.silence, frame.recorded, frame.shown, self.watch.due, dt_s, self.settings):
            what = "camera silent" if silent else "camera heard again"
            self.events.append(Event(frame.number, self.time_s, self.settings.rig.names[v], what, why))

    def _shown(self, frame: Frame, rows: np.ndarray, p: int, sight: Sight) -> Evidence:
        """What this frame showed of somebody who is followed."""
        s = self.settings
        shape = (len(s.rig), len(s.skeleton))
        pixels, trust = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
        for v in np.flatnonzero(rows >= 0):
            order = self.labels[self._keep[p], v]
            pixels[v], trust[v] = frame.keypoints_px[rows[v]][order], frame.confidence[rows[v]][order]
        points, covariance = sight.points_m[p], sight.covariance_m2[p]
        return Evidence(
            self.time_s, frame.number, pixels, trust, rows, points, covariance, self.state.root[p].copy(), 0.0, 1.0
        )

    def _conclude(self, finding: identity_audit.Finding, number: int) -> None:
        place = {track.name: p for p, track in enumerate(self.tracks)}
        p, q = (place[name] for name in finding.names)
        other = finding.names
        if finding.exchange:
            lifecycle.exchange(self.tracks, self.state, p, q)
            identity_audit.forget(self.contacts, finding.names)
            self.exchanged.append(((self.tracks[p].number, self.tracks[q].number), finding.since_s))
            why = f"its bones are those of {other[1]}, log odds {-finding.odds:.1f}"
            self.events.append(Event(number, self.time_s, other[0], "identities exchanged", why))
        elif not finding.clear:
            why = f"it may be {other[1]} after they were too near to tell, log odds {finding.odds:.1f}"
            self.events.append(Event(number, self.time_s, other[0], "identity uncertain", why))

    def _free(self, frame: Frame, rows: np.ndarray, *, whole: bool = False) -> np.ndarray:
        """Shape (row,), bool: detections that are nobody's, nor a second one of somebody's.

        Those of refused cameras count only for the ``whole``.
        """
        free = ~self.explained
        free[rows[rows >= 0]] = False
        return free if whole else free & ~self.watch.refused[frame.view]

    def _found(self, frame: Frame, free: np.ndarray) -> list[Evidence]:
        """What the free detections propose, but for people who are followed already."""
        s = self.settings
        active = [p for p, track in enumerate(self.tracks) if track.state == TrackState.ACTIVE]
        views = frame.view[free]
        if not len(views) or views[0] == views[-1]:
            return []
        known = self.sight.points_m[self._keep][active]
        proposals = self.propose(frame, free)
        found = []
        for i in range(len(proposals)):
            away = np.linalg.norm(known - proposals.points_m[i], axis=-1)
            if len(active) and (np.nanmean(away, axis=1) < s.options.births.apart_m).any():
                continue
            one = evidence_of(frame, self.time_s, proposals, i, s.skeleton.mirror)
            if one.n_views <= s.options.births.min_views:
                silent = silent_views(one.points_m, one.rows, frame, self.watch.refused, s)
                one = replace(one, n_silent=int(silent.sum()))
            found.append(one)
        return self.stages.distance.merge(found, s)

    def _believe(self, each: Tentative, number: int, held: dict[int, int]) -> tuple[int, np.ndarray] | None:
        """Begin to follow somebody, under a new name or that of somebody lost; their place, and what counted.

        None where no body fits what was seen, or somebody's is there already.

        Args:
            each: the one who is believed.
            number: of the frame.
            held: from :meth:`_held_by_one_view`.
        """
        s = self.settings
        bounds = self._bounds()
        state, past, error = begin(each.evidence, s)
        if not error <= s.options.births.max_error_sigma:
            return None
        seen = each.evidence[-1]
        counted = np.isfinite(seen.keypoints_px[..., 0])
        theirs = [held[int(row)] for row in seen.rows if int(row) in held]
        if theirs:
            found = theirs[0], "others see them again, whom one camera had kept", ""
        elif self._is_taken(state):
            return None
        else:
            found = self.stages.distance.returning(
                self.tracks, self.state, state, seen, each.evidence[0].time_s, self.time_s, s
            )
        if found is not None:
            p, why, uncertain = found
            track = self.tracks[p]
            lifecycle.take_back(self.state, p, state, s)
            self.innovations.pop(track.number, None)
            for mine, unknown in zip(self.lately, self._unknown(1), strict=True):
                mine[p] = unknown[0]
            self.events.append(Event(number, self.time_s, track.name, "returned", why))
            if uncertain:
                self.events.append(Event(number, self.time_s, track.name, "identity uncertain", uncertain))
        elif len(self.tracks) >= s.options.max_people or all_are_known(self.tracks, s):
            return None
        else:
            self.names += 1
            track = lifecycle.newcomer(self.names, self.time_s, bounds)
            self.tracks.append(track)
            self.state, self.lately = joined(self.state, state), self.lately.joined(self._unknown(1))
            p = len(self.tracks) - 1
            why = f"seen by {seen.n_views} cameras, {error:.1f} sigma off"
            self.events.append(Event(number, self.time_s, track.name, "born", why))
        track.state, track.lost_at_m = TrackState.ACTIVE, seen.torso_m
        track.seen_s = track.firm_s = self.time_s
        track.log_odds = bounds.begins_with
        self.remembered[track.name] = past
        return p, counted

    def _is_taken(self, state: State) -> bool:
        """Whether an active person's body is where this one is: two proposals may be of pieces of one person."""
        active = [p for p, track in enumerate(self.tracks) if track.state == TrackState.ACTIVE]
        together, s = joined(chosen(self.state, active), state), self.settings
        points = Sight.of(together, s.cameras[:0], s.body).points_m
        away = np.linalg.norm(points[:-1] - points[-1], axis=-1)
        return bool((np.nanmean(away, axis=1) < s.options.births.apart_m).any())

    def _bounds(self) -> Bounds:
        score, s = self.stages.score, self.settings
        return Bounds(score.begins_with(s), score.lost_below(s), score.sure_from(s))

    def _foreseen(self, cameras: np.ndarray) -> Sight:
        """Where everybody is, and where these cameras, none or all of them, see them."""
        return Sight.of(self.state, cameras, self.settings.body)

    def _follow_parts(self, frame: Frame, rows: np.ndarray, used: np.ndarray, sight: Sight, dt_s: float) -> None:
        """Follow hands and faces; where they are, and what counted of them, into ``sight`` and ``used``."""
        names = tuple(track.name for track in self.tracks)
        labels = np.tile(np.arange(len(self.settings.skeleton)), (*rows.shape, 1))
        for sides in self.sides:
            swap_sides(labels, frame, rows, sight, sides, self.settings.tree.scale)
        bodies = Bodies.of(names, rows, labels, sight, self.state)
        for follower in self.parts:
            for numbers, _ in self.exchanged:
                follower.exchange({track.name for track in self.tracks if track.number in numbers})
            follower.update(frame, self.time_s, dt_s, bodies)
        for follower in self.parts:
            k = follower.part.keypoints
            for person in follower.people:
                p = names.index(person.name)
                sight.points_m[p, k], sight.covariance_m2[p, k] = person.points_m, person.covariance_m2
                used[p][:, k] = person.used

    def _told(self, number: int, rows: np.ndarray, used: np.ndarray, sight: Sight) -> People:
        people = [
            Person(
                track.name,
                track.state,
                sight.points_m[p],
                sight.covariance_m2[p],
                rows[p],
                used[p],
                track.log_odds,
                self.time_s - track.seen_s,
                *self.innovations.get(track.number, (np.nan, 0)),
            )
            for p, track in enumerate(self.tracks)
        ]
        people.sort(key=lambda person: person.state != TrackState.ACTIVE)
        for each in self.tentative:
            last = each.evidence[-1]
            if last.time_s == self.time_s:
                people.append(
                    Person(
                        f"tentative_{each.number}",
                        TrackState.TENTATIVE,
                        last.points_m,
                        last.covariance_m2,
                        last.rows,
                        np.isfinite(last.keypoints_px[..., 0]),
                        each.score,
                        0.0,
                    )
                )
        return People(number, self.time_s, tuple(people), tuple(self.events))
