"""The tracker's loop: foresee, match, put right, live on or be lost, be born. See docs/methods.md, "People"."""

from collections.abc import Callable

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.kernels.articulated import GATED, USED, State, foresee_people, predict_people, update_people
from posefuse.kernels.matching import match_views, score_detections
from posefuse.model.frames import SAME_TIME_S, Frame
from posefuse.model.life import Event
from posefuse.model.proposals import Proposals
from posefuse.model.tracks import TrackState
from posefuse.tracking import audits, lifecycle
from posefuse.tracking.audits import Contact
from posefuse.tracking.births import begin
from posefuse.tracking.bodies import Sight, chosen, joined, nobody
from posefuse.tracking.parts import Bodies, PartFollower, sides_of, swap_sides
from posefuse.tracking.records import Evidence, People, Person, Remembered, Tentative, Track
from posefuse.tracking.returns import who_returns
from posefuse.tracking.settings import Settings, tempering
from posefuse.tracking.tentative import continue_with, evidence_of, is_believable, is_over
from posefuse.tracking.watch import Watch, look_at

_EXPLAINED = 3.0
"""A detection of this much evidence is somebody's who is followed, even if another one is more so."""

Propose = Callable[[Frame, np.ndarray], Proposals]
"""From a frame, and which of its rows are free, shape (row,), to people whom several views show."""


class ArticulatedTracker:
    """Follows people from one frame to the next; causal, and nothing is kept anywhere else.

    Args:
        settings: what it works with.
        propose: finds people among detections that are nobody's.
    """

    def __init__(self, settings: Settings, propose: Propose) -> None:
        self.settings = settings
        self.propose = propose
        self.tracks: list[Track] = []
        self.state = nobody(settings.tree)
        self.tentative: list[Tentative] = []
        self.time_s = float("nan")
        self.names = 0
        self.guesses = 0
        self.remembered: dict[str, list[Remembered]] = {}
        """Of people first believed in the last frame: their states in the frames before."""
        self.events: list[Event] = []
        self.exchanged: list[tuple[tuple[str, str], float]] = []
        """Who, as was found in the last frame, have been taken for each other, and since when."""
        self.parts = tuple(PartFollower(part, settings) for part in settings.skeleton.parts)
        """Hands and faces; nothing of them goes back to the bodies."""
        self.sides = sides_of(self.parts, settings.skeleton.mirror)
        self.watch = Watch.over(len(settings.rig))
        self.contacts: dict[tuple[str, str], Contact] = {}

    def update(self, frame: Frame) -> People:
        """Take a frame, later than the last; who is where.

        Raises:
            DetectionsError: if the frame does not fit the cameras or the skeleton, or is not later than the last.
        """
        time_s = self._time_of(frame)
        self.events, self.exchanged, self.remembered = [], [], {}
        dt_s = 0.0 if np.isnan(self.time_s) else time_s - self.time_s
        self.time_s = time_s
        rows, used = self._follow(frame, dt_s)
        self._live_on(frame, rows, used, dt_s)
        self._tell_apart(frame, rows, used, dt_s)
        rows, used = self._bear(frame, rows, used)
        sight = Sight.room(len(self.tracks), len(self.settings.rig), len(self.settings.skeleton))
        foresee_people(self.settings.cameras, self.settings.body, self.state, *sight.arrays)
        if self.parts:
            self._follow_parts(frame, rows, used, sight, dt_s)
        return self._told(frame.number, rows, used, sight)

    def shape_of(self, p: int) -> tuple[np.ndarray, np.ndarray]:
        """The shape of a body and its standard deviations, shape (shape,) each, m."""
        tree, track = self.settings.tree, self.tracks[p]
        n, h = tree.n_pose, tree.n_shape
        block = track.trusted[1] if track.trusted else self.state.covariance[p, n : n + h, n : n + h]
        return self.state.shape[p].copy(), np.sqrt(np.diag(block))

    def _time_of(self, frame: Frame) -> float:
        views, keypoints = len(self.settings.rig), len(self.settings.skeleton)
        if len(frame.recorded) != views or (len(frame.view) and frame.keypoints_px.shape[1] != keypoints):
            raise DetectionsError(
                f"Frame {frame.number} has {len(frame.recorded)} views and {frame.keypoints_px.shape[1]} keypoints a "
                f"person; this tracker has {views} cameras and {keypoints} keypoints."
            )
        known = frame.time_s[np.isfinite(frame.time_s) & frame.recorded]
        if not len(known):
            raise DetectionsError(
                f"Frame {frame.number} has no time, and how far people move depends on it. Give the frame rate "
                "(--rate-hz, Options.rate_hz) or times."
            )
        # Views of a frame that were taken one after the other are taken into account one after the other.
        time_s = float(known.mean() if np.ptp(known) < SAME_TIME_S else known.max())
        if time_s <= self.time_s:
            raise DetectionsError(
                f"Frame {frame.number} is of {time_s:.4f} s, the last was of {self.time_s:.4f} s. Frames come in order."
            )
        return time_s

    def _follow(self, frame: Frame, dt_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Foresee everybody, match detections, put states right: rows (track, view), used (track, view, keypoint)."""
        s, n = self.settings, len(self.tracks)
        views, keypoints = len(s.rig), len(s.skeleton)
        if not n:
            self.sight = Sight.room(0, views, keypoints)
            self.explained = np.zeros(len(frame.view), dtype=bool)
            return np.empty((0, views), dtype=np.int64), np.empty((0, views, keypoints), dtype=bool)
        moments = frame.moments
        before = chosen(self.state, np.arange(n)) if len(moments) > 1 else None
        self._move_on(self.state, dt_s)
        self.sight = Sight.room(n, views, keypoints)
        foresee_people(s.cameras, s.body, self.state, *self.sight.arrays)
        rows, swapped = self._match(frame)
        self._hold_back_lost(rows)
        labels = self.labels = self._labels(rows, swapped)
        use = self._put_right(frame, rows, labels, before, dt_s)
        self._set_limbs_anew(frame, use, dt_s)
        for p, track in enumerate(self.tracks):
            for v in np.flatnonzero(rows[p] >= 0):
                track.swapped[v] = swapped[p, rows[p, v]]
                track.ids[v] = frame.track_ids[rows[p, v]]
        return rows, use == USED

    def _move_on(self, state: State, dt_s: float) -> None:
        s = self.settings
        dt = np.full(len(state.root), max(dt_s, 0.0))
        predict_people(dt, s.decay_s, s.power, s.most, s.options.motion.shape_walk, state)

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
        temper = tempering(np.full(n, dt_s), s.options.error_memory_s)
        use = np.empty((n, *labels.shape[1:]), dtype=np.int64)

        def update(rows: np.ndarray, use: np.ndarray) -> None:
            update_people(
                s.cameras, s.body, s.law, temper, s.options.iterations, rows, labels, frame.keypoints_px,
                frame.confidence, self.state, use, np.empty(n), np.empty(n),
            )  # fmt: skip

        if before is None:
            update(rows, use)
            return use
        self.state, now_s = before, self.time_s - dt_s
        for time_s, views in frame.moments:
            self._move_on(self.state, time_s - now_s)
            now_s = max(now_s, time_s)
            part = np.empty_like(use)
            update(np.where(views, rows, -1), part)
            use[:, views] = part[:, views]
        return use

    def _set_limbs_anew(self, frame: Frame, use: np.ndarray, dt_s: float) -> None:
        """Limbs that most views have seen elsewhere for some time are as good as unknown."""
        gated, used = (use == GATED).sum(axis=1), (use == USED).sum(axis=1)
        off = (gated >= 2) & (gated > used)
        for p, track in enumerate(self.tracks):
            track.off_s = np.where(off[p], track.off_s + dt_s, 0.0)
            if track.off_s.max(initial=0.0) < self.settings.options.limb_anew_s:
                continue
            k = int(track.off_s.argmax())
            track.off_s[:] = 0.0
            if lifecycle.set_limb_anew(self.state, p, k, self.settings):
                name = self.settings.skeleton.keypoints[k]
                why = f"{gated[p, k]} cameras see the {name} elsewhere"
                self.events.append(Event(frame.number, self.time_s, track.name, "limb set anew", why))

    def _match(self, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
        """Rows (track, view), and whose sides are exchanged (track, row, group)."""
        s, o, n = self.settings, self.settings.options, len(self.tracks)
        scores = np.empty((n, len(frame.view)))
        swapped = np.zeros((n, len(frame.view), s.n_groups), dtype=np.int8)
        score_detections(
            self.sight.pixels, self.sight.spread, self.sight.size_px, frame.keypoints_px, frame.confidence, frame.view,
            s.skeleton.mirror, s.group_of, s.n_groups, s.law, np.stack([t.swapped for t in self.tracks]),
            o.swap_log_odds, o.swap_stay_log_odds, o.clutter_m, o.keypoint_evidence, o.independent_keypoints, scores,
            swapped,
        )  # fmt: skip
        ids = np.stack([t.ids for t in self.tracks])[:, frame.view]
        scores += o.id_evidence * ((ids == frame.track_ids) & (frame.track_ids >= 0))
        rows = np.empty((n, len(s.rig)), dtype=np.int64)
        match_views(scores, frame.view, len(s.rig), o.match_evidence, rows)
        self.explained = (scores > _EXPLAINED).any(axis=0)
        _believe_most_labels(rows, swapped)
        return rows, swapped

    def _hold_back_lost(self, rows: np.ndarray) -> None:
        """One view alone does not move somebody who is lost."""
        for p, track in enumerate(self.tracks):
            if track.state == TrackState.LOST and (rows[p] >= 0).sum() < self.settings.options.reacquire_views:
                rows[p] = -1

    def _labels(self, rows: np.ndarray, swapped: np.ndarray) -> np.ndarray:
        s = self.settings
        labels = np.tile(np.arange(len(s.skeleton)), (*rows.shape, 1))
        for p, v in zip(*np.nonzero(rows >= 0), strict=True):
            turned = swapped[p, rows[p, v]]
            if turned.any():
                of = (s.group_of >= 0) & (turned[s.group_of] != 0)
                labels[p, v, of] = s.skeleton.mirror[of]
        return labels

    def _live_on(self, frame: Frame, rows: np.ndarray, used: np.ndarray, dt_s: float) -> None:
        """Who is supported, who is lost, who is forgotten."""
        supported = used.sum(axis=2) >= self.settings.options.min_joints
        self.supported = supported
        self.expected = lifecycle.expected(self.sight, self.settings) & frame.recorded
        expected = self.expected & ~self.watch.refused
        torsos = lifecycle.middles(self.sight.points_m[:, self.settings.core])
        for p, track in enumerate(self.tracks):
            torso = torsos[p]
            said = lifecycle.live_on(track, supported[p], expected[p], torso, self.time_s, dt_s, self.settings)
            self.events.extend(Event(frame.number, self.time_s, track.name, what, why) for what, why in said)
            lifecycle.settle_shape(track, self.state, p, self.time_s, self.settings)
        if self.settings.options.outside_s is not None:
            lifecycle.note_inside(self.tracks, self.sight, self.time_s, self.settings)
        over = lifecycle.forgotten(self.tracks, self.state, self.time_s, self.settings)
        for p, why in over.items():
            self.events.append(Event(frame.number, self.time_s, self.tracks[p].name, "forgotten", why))
        if over:
            keep = [p for p in range(len(self.tracks)) if p not in over]
            self.tracks = [self.tracks[p] for p in keep]
            self.state = chosen(self.state, keep)
            self._keep = keep
        else:
            self._keep = list(range(len(self.tracks)))

    def _bear(self, frame: Frame, rows: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Who is new: proposals from free detections, tentative people, and those of them who are believed now."""
        rows, used = rows[self._keep], used[self._keep]
        free, held = self._free(frame, rows), self._held_by_one_view(rows)
        free[list(held)] = True
        found = self._found(frame, free)
        new = continue_with(self.tentative, found, self.time_s, self.settings)
        for each in new:
            self.guesses += 1
            self.tentative.append(Tentative(self.guesses, [each]))
        staying = []
        for each in self.tentative:
            if is_believable(each, self.time_s, self.settings):
                born = self._believe(each, frame.number, held)
                if born is not None:
                    p, counted = born
                    if p < len(rows):
                        rows[p], used[p] = each.evidence[-1].rows, counted
                    else:
                        rows, used = np.vstack([rows, each.evidence[-1].rows]), np.vstack([used, counted[None]])
                    continue
            if not is_over(each, self.time_s, self.settings):
                staying.append(each)
        self.tentative = staying
        return rows, used

    def _held_by_one_view(self, rows: np.ndarray) -> dict[int, int]:
        """Detections to the people whom nothing else has shown for some time, by place.

        How far away those are is hardly known. Where others see the person of that detection elsewhere, they are there.
        """
        held = {}
        for p, track in enumerate(self.tracks):
            mine = rows[p][rows[p] >= 0]
            if len(mine) == 1 and self.time_s - track.firm_s > self.settings.options.weak_after_s:
                held[int(mine[0])] = p
        return held

    def _tell_apart(self, frame: Frame, rows: np.ndarray, used: np.ndarray, dt_s: float) -> None:
        """Which cameras still stand where they stood, and who is who after people were too near to tell."""
        n, number = len(self.settings.rig), frame.number
        active = np.array([track.state == TrackState.ACTIVE for track in self.tracks], dtype=bool)
        keep = self._keep
        supported, expected = self.supported[keep], self.expected[keep]
        free = np.bincount(frame.view[self._free(frame, rows[keep], whole=True)], minlength=n)
        for v, refused, why in look_at(self.watch, supported[active], expected[active], free, dt_s, self.settings):
            what = "camera refused" if refused else "camera trusted"
            self.events.append(Event(number, self.time_s, self.settings.rig.names[v], what, why))
        scale = self.settings.tree.scale
        audits.contacts(self.contacts, self.tracks, self.state, supported, expected, self.time_s, dt_s, scale)
        if self.contacts:
            for p, track in enumerate(self.tracks):
                if supported[p].sum() > 1:
                    audits.remember(self.contacts, track.name, self._shown(frame, rows[keep][p], p))
            for finding in audits.audit(self.contacts, self.tracks, self.state, self.time_s, self.settings):
                self._conclude(finding, number)

    def _shown(self, frame: Frame, rows: np.ndarray, p: int) -> Evidence:
        """What this frame showed of somebody who is followed."""
        s = self.settings
        shape = (len(s.rig), len(s.skeleton))
        pixels, trust = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
        for v in np.flatnonzero(rows >= 0):
            order = self.labels[self._keep[p], v]
            pixels[v], trust[v] = frame.keypoints_px[rows[v]][order], frame.confidence[rows[v]][order]
        sight = Sight.room(len(self.tracks), *shape)
        foresee_people(s.cameras, s.body, self.state, *sight.arrays)
        points, covariance = sight.points_m[p], sight.covariance_m2[p]
        return Evidence(
            self.time_s, frame.number, pixels, trust, rows, points, covariance, self.state.root[p].copy(), 0.0, 1.0
        )

    def _conclude(self, finding: audits.Finding, number: int) -> None:
        place = {track.name: p for p, track in enumerate(self.tracks)}
        p, q = (place[name] for name in finding.names)
        other = finding.names
        if finding.exchange:
            lifecycle.exchange(self.tracks, self.state, p, q)
            self.exchanged.append((finding.names, finding.since_s))
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
        known = self.sight.points_m[self._keep][active]
        proposals = self.propose(frame, free)
        found = []
        for i in range(len(proposals)):
            away = np.linalg.norm(known - proposals.points_m[i], axis=-1)
            if len(active) and (np.nanmean(away, axis=1) < s.options.births.apart_m).any():
                continue
            found.append(evidence_of(frame, self.time_s, proposals, i, s.skeleton.mirror))
        return found

    def _believe(self, each: Tentative, number: int, held: dict[int, int]) -> tuple[int, np.ndarray] | None:
        """Begin to follow somebody, under a new name or that of somebody lost; their place, and what counted.

        None where no body fits what was seen.

        Args:
            each: the one who is believed.
            number: of the frame.
            held: from :meth:`_held_by_one_view`.
        """
        s = self.settings
        state, past, error = begin(each.evidence, s)
        if not error <= s.options.births.max_error_sigma:
            return None
        seen = each.evidence[-1]
        counted = np.isfinite(seen.keypoints_px[..., 0])
        theirs = [held[int(row)] for row in seen.rows if int(row) in held]
        if theirs:
            found = theirs[0], "others see them again, whom one camera had kept", ""
        else:
            found = who_returns(self.tracks, self.state, state, seen.torso_m, self.time_s, s)
        if found is not None:
            p, why, uncertain = found
            track = self.tracks[p]
            lifecycle.take_back(track, self.state, p, state, s)
            self.events.append(Event(number, self.time_s, track.name, "returned", why))
            if uncertain:
                self.events.append(Event(number, self.time_s, track.name, "identity uncertain", uncertain))
        elif len(self.tracks) >= s.options.max_people:
            return None
        else:
            self.names += 1
            track = lifecycle.newcomer(f"person_{self.names}", self.time_s, s)
            self.tracks.append(track)
            self.state = joined(self.state, state)
            p = len(self.tracks) - 1
            views = f"{seen.n_views} cameras"
            self.events.append(
                Event(number, self.time_s, track.name, "born", f"seen by {views}, {error:.1f} sigma off")
            )
        track.state, track.lost_at_m = TrackState.ACTIVE, seen.torso_m
        track.seen_s = track.firm_s = self.time_s
        track.log_odds = s.options.most_log_odds / 2
        self.remembered[track.name] = past
        return p, counted

    def _follow_parts(self, frame: Frame, rows: np.ndarray, used: np.ndarray, sight: Sight, dt_s: float) -> None:
        """Follow hands and faces; where they are, and what counted of them, into ``sight`` and ``used``."""
        names = tuple(track.name for track in self.tracks)
        labels = np.tile(np.arange(len(self.settings.skeleton)), (*rows.shape, 1))
        for sides in self.sides:
            swap_sides(labels, frame, rows, sight, sides, self.settings.tree.scale)
        bodies = Bodies.of(names, rows, labels, sight, self.state)
        for follower in self.parts:
            for pair, _ in self.exchanged:
                follower.exchange(pair)
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
                        sum(e.log_odds for e in each.evidence),
                        0.0,
                    )
                )
        return People(number, self.time_s, tuple(people), tuple(self.events))


def _believe_most_labels(rows: np.ndarray, swapped: np.ndarray) -> None:
    """Where most views would have a limb's sides exchanged, it is the body that has: labels are right.

    Args:
        rows: shape (track, view).
        swapped: shape (track, row, group), in and out.
    """
    if not swapped.any():
        return
    for p, mine in enumerate(rows):
        matched = mine[mine >= 0]
        if len(matched):
            most = 2 * swapped[p, matched].sum(axis=0) >= len(matched)
            swapped[p, :, most] = 0
