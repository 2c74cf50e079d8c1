"""From where the axes are to where the tip is wanted: a path, or why there is none."""

from collections.abc import Sequence
from math import inf
from typing import Final

import numpy as np

from daemon.host.progress import Progress, Unheard
from daemon.workbench.planning import blocked
from daemon.workbench.planning.blocked import Blocked
from daemon.workbench.planning.body_in_place import NOWHERE, BodyInPlace, Standing
from daemon.workbench.planning.goals import TipGoal, places_for
from daemon.workbench.planning.path_risk import PathRisk, PathRisks, printed_path_risk, resampled
from daemon.workbench.planning.plan import Candidate, Plan, Settings
from daemon.workbench.planning.refinement import Refinement
from daemon.workbench.planning.roadmap import (
    Judge,
    Preference,
    Roadmap,
    make_roadmap,
)
from daemon.workbench.planning.timing import Speeds, times_along
from safety.risk.model.mixture import FloatArray

_FROM_ANYWHERE: Final = 24
"""Beginnings from which a goal is looked for."""
_WAYS_TO_BE_THERE: Final = 6
"""Postures in which the tip may be at a goal, at most."""
_DENSER: Final = 4
"""So many times the places are looked at before it is said that there is no way."""
_SEARCHED_RISK: Final = 0.5
"""Of the most that a path may have: a place or a way of it with more is not gone."""
PREFERENCES_MM: Final = (0.0, 30.0, 100.0, 300.0, 1000.0)
"""By which length and risk are weighed against each other: mm of the body's way for each factor of
e in risk."""


class Planner:
    """Of one body in one place: its roadmap is made once. Not for several threads."""

    def __init__(
        self, body: BodyInPlace, settings: Settings | None = None, progress: Progress | None = None
    ) -> None:
        self.body = body
        self.settings = settings or Settings()
        self._progress = Unheard() if progress is None else progress
        one = self.settings
        self.risks = PathRisks(body, one.samples, one.seed + 1)
        self._refinement = Refinement(body, self.risks, one.waypoints, one.iterations, one.seed)
        self._roadmaps: dict[int, Roadmap] = {}

    @property
    def roadmap(self) -> Roadmap:
        """Made when it is first asked for."""
        return self._roadmap_of(self.settings.places)

    def _roadmap_of(self, places: int) -> Roadmap:
        if places not in self._roadmaps:
            one = self.settings
            self._roadmaps[places] = make_roadmap(
                self.body, places, one.neighbours, one.seed, self._progress
            )
        return self._roadmaps[places]

    def plan(self, start: FloatArray, goals: Sequence[TipGoal]) -> Plan | Blocked:
        """From (m,) axes by way of all goals, in their order, to the last of them."""
        found = self._searched(start, goals, self._preference(self.settings.mm_per_nat))
        if isinstance(found, Blocked):
            return found
        whole = _joined(found)
        before = self.risks.of(whole)
        printed_before = self._printed(whole)
        legs = [self._refinement.of(leg, self._progress) for leg in found]
        refined = _joined([leg.waypoints for leg in legs])
        risk = legs[0].risk if len(legs) == 1 else self.risks.of(refined)
        if risk.upper_limit > self.settings.most_risk:
            return blocked.too_risky(risk.upper_limit, self.settings.most_risk, risk.worst)
        return self._timed(refined, risk, self._printed(refined), before, printed_before)

    def pareto(self, start: FloatArray, goals: Sequence[TipGoal]) -> list[Candidate] | Blocked:
        """The roadmap's paths of several preferences, without those that another one is better
        than in length and in risk; the shortest first."""
        candidates: list[Candidate] = []
        for mm_per_nat in PREFERENCES_MM:
            found = self._searched(start, goals, self._preference(mm_per_nat))
            if isinstance(found, Blocked):
                return found
            candidates.append(self._candidate(mm_per_nat, _joined(found)))
        front = [one for one in candidates if not any(_dominates(o, one) for o in candidates)]
        unique = {(round(one.length_mm, 6), one.risk.upper_limit): one for one in front}
        return sorted(unique.values(), key=lambda one: one.length_mm)

    def nominal(self, start: FloatArray, goals: Sequence[TipGoal]) -> Candidate | Blocked:
        """The path as the paper plans it first: all means free, the shortest in the roadmap."""
        preference = Preference(0.0, 1.0)
        found = self._searched(start, goals, preference, _MeansFree(self.body))
        return found if isinstance(found, Blocked) else self._candidate(0.0, _joined(found))

    def figured(self, waypoints: FloatArray, nominal: Candidate) -> Plan:
        """What another method made, of (n, m) waypoints, of a nominal path."""
        risk = self.risks.of(waypoints)
        printed = self._printed(waypoints)
        return self._timed(waypoints, risk, printed, nominal.risk, nominal.printed)

    def _printed(self, waypoints: FloatArray) -> float:
        """Equation 10 over as many places as the settings say."""
        return printed_path_risk(
            self.body, resampled(self.body, waypoints, self.settings.waypoints)
        )

    def _preference(self, mm_per_nat: float) -> Preference:
        return Preference(mm_per_nat, _SEARCHED_RISK * self.settings.most_risk)

    def _candidate(self, mm_per_nat: float, waypoints: FloatArray) -> Candidate:
        body = self.body
        return Candidate(
            mm_per_nat,
            waypoints,
            body.length_mm(body.finely(waypoints)),
            self.risks.of(waypoints),
            self._printed(waypoints),
        )

    def _timed(
        self,
        waypoints: FloatArray,
        risk: PathRisk,
        printed: float,
        before: PathRisk,
        printed_before: float,
    ) -> Plan:
        body = self.body
        u = body.finely(waypoints)
        tips = np.array([body.tip(one) for one in u])
        room_mm = np.array([body.at_rest(one).lowest_5_percent_mm for one in u])
        t_s = times_along(body, u, room_mm, Speeds.of(body.robot, self.settings.tip_mm_s))
        length_mm = body.length_mm(u)
        return Plan(
            u, t_s, tips[:, :3], tips[:, 3:], risk, printed, length_mm, before, printed_before
        )

    def _searched(
        self,
        start: FloatArray,
        goals: Sequence[TipGoal],
        preference: Preference,
        means_free: "_MeansFree | None" = None,
    ) -> list[FloatArray] | Blocked:
        """(n, m) of the roadmap for each leg from the start by way of all goals."""
        judge: Judge = self.body.way if means_free is None else means_free.way
        stand = self.body.standing if means_free is None else means_free.standing
        if (problem := self._start_problem(start, stand(start, 1.0), preference)) is not None:
            return problem
        legs: list[FloatArray] = []
        for goal in goals:
            begin = legs[-1][-1] if legs else start
            leg = self._leg(begin, goal, preference, judge, means_free)
            if isinstance(leg, Blocked):
                return leg
            legs.append(leg)
        return legs

    def _start_problem(
        self, start: FloatArray, standing: Standing, preference: Preference
    ) -> Blocked | None:
        if not standing.allowed:
            return Blocked(
                "start_not_allowed",
                "there is none: where it starts is outside of what axes, coupled limits, workspace "
                "or the body's model allow; plan from somewhere else",
            )
        if standing.risk > preference.most_risk:
            worst = standing.worst or self.body.at_rest(start).worst
            return blocked.start_blocked(self.body, standing.risk, worst)
        return None

    def _leg(
        self,
        start: FloatArray,
        goal: TipGoal,
        preference: Preference,
        judge: Judge,
        means_free: "_MeansFree | None",
    ) -> FloatArray | Blocked:
        """(n, m) from the start to the goal."""
        body, roadmap = self.body, self.roadmap
        if means_free is None:
            if (problem := blocked.goal_in_the_way(body, goal.place_mm)) is not None:
                return problem
        else:
            roadmap = means_free.of(roadmap)
        ends = self._ends(start, goal, roadmap)
        if isinstance(ends, Blocked):
            return ends
        stand = body.standing if means_free is None else means_free.standing
        standings = [stand(u) for u in ends]
        good = [one.allowed and one.risk <= preference.most_risk for one in standings]
        if not any(good):
            best = min(standings, key=lambda one: one.risk)
            seen = best if best.worst is not None else body.standing(ends[0])
            return blocked.goal_touches(body, goal.place_mm, seen)
        more, standings = np.array([start, *ends]), [stand(start, 1.0), *standings]
        judge = _from(start, body, judge, means_free)
        for denser in (False, True):
            if denser:
                roadmap = self._roadmap_of(_DENSER * self.settings.places)
                roadmap = roadmap if means_free is None else means_free.of(roadmap)
            count = len(roadmap.places)
            joined = roadmap.joined_with(more, standings)
            numbers = [count + 1 + number for number, one in enumerate(good) if one]
            found = joined.path(count, numbers, preference, judge)
            if found is not None:
                return found.places
        return self._why_no_way(joined, count, numbers)

    def _ends(
        self, start: FloatArray, goal: TipGoal, roadmap: Roadmap
    ) -> list[FloatArray] | Blocked:
        """(m,) postures with the tip at the goal."""
        beginnings = [start]
        if len(roadmap.places):
            off = np.linalg.norm(roadmap.tips() - goal.place_mm, axis=1)
            risky = np.array([one.risk for one in roadmap.standings])
            order = np.lexsort((off, off + 50.0 * (risky > _SEARCHED_RISK)))
            beginnings += list(roadmap.places[order[:_FROM_ANYWHERE]])
        found = places_for(self.body, goal, beginnings, _WAYS_TO_BE_THERE)
        if found.places:
            return found.places
        tip = self.body.tip(found.nearest_u)[:3]
        return blocked.goal_out_of_reach(goal.place_mm, tip, found.nearest_mm)

    def _why_no_way(self, roadmap: Roadmap, start: int, goals: Sequence[int]) -> Blocked:
        """What blocks on the least bad way, if all risks were taken."""
        judge = _from(roadmap.places[start], self.body, self.body.way, None)
        anyhow = roadmap.path(start, goals, Preference(3000.0, 1.0), judge)
        return blocked.way_blocked(self.body, None if anyhow is None else anyhow.worst)


class _MeansFree:
    """The paper's own test: all means of the mixture over the body's points are free."""

    def __init__(self, body: BodyInPlace) -> None:
        self._body = body

    def of(self, roadmap: Roadmap) -> Roadmap:
        """The same places, judged so. No way is known yet."""
        judged = [self.standing(u) for u in roadmap.places]
        return Roadmap(self._body, roadmap.places, judged, 10)

    def standing(self, u: FloatArray, closer_than: float = 1.0) -> Standing:
        free = self._body.allowed(u, closer_than) and self._body.means_free(u)
        return Standing(True, 0.0, inf, None) if free else NOWHERE

    def way(self, start: FloatArray, end: FloatArray, closer_than: float = 1.0) -> Standing:
        places = self._body.places(start, end)
        free = all(self.standing(u, closer_than).allowed for u in places[1:])
        return Standing(True, 0.0, inf, None) if free else NOWHERE


def _from(
    start: FloatArray, body: BodyInPlace, judge: Judge, means_free: "_MeansFree | None"
) -> Judge:
    """A robot may stand where the model hardly knows it; from there it may go all the same."""

    def way(a: FloatArray, b: FloatArray) -> Standing:
        at_start = np.array_equal(a, start) or np.array_equal(b, start)
        if means_free is None and at_start:
            return body.way(a, b, 1.0)
        return judge(a, b)

    return way


def _joined(legs: Sequence[FloatArray]) -> FloatArray:
    """(n, m) of legs of which each begins where the last one ends."""
    return np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])


def _dominates(a: Candidate, b: Candidate) -> bool:
    """Whether a is better than b in one, and worse in neither."""
    shorter = a.length_mm <= b.length_mm and a.risk.upper_limit <= b.risk.upper_limit
    return shorter and (a.length_mm < b.length_mm or a.risk.upper_limit < b.risk.upper_limit)
