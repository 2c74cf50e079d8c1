"""Reasons as people read them: what is to be mended first, and under it what follows from it."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from daemon.messages import Reason

_SUBJECTS: Final = 4
"""More than these of one cause are counted and not named."""


@dataclass
class ReasonGroup:
    """A reason, the same about other subjects, and what follows from it."""

    lead: Reason
    alike: list[Reason] = field(default_factory=list)
    follow: dict[str, list[Reason]] = field(default_factory=dict)
    """By the cause's name."""

    @property
    def subjects(self) -> str:
        """Of the lead, and of those that are like it."""
        return subjects((self.lead, *self.alike))


def grouped(reasons: Iterable[Reason]) -> list[ReasonGroup]:
    """In the order in which they are told."""
    groups: list[ReasonGroup] = []
    for reason in reasons:
        if not (reason.follows_from and groups):
            groups.append(ReasonGroup(reason))
        elif reason.name == groups[-1].lead.name:
            groups[-1].alike.append(reason)
        else:
            groups[-1].follow.setdefault(reason.name, []).append(reason)
    return groups


def subjects(reasons: Sequence[Reason]) -> str:
    """`can0/1, can0/2`: each subject once, without the condition that a driver names with it."""
    named = list(dict.fromkeys(reason.subject.partition(" ")[0] for reason in reasons))
    if len(named) <= _SUBJECTS:
        return ", ".join(named)
    return f"{', '.join(named[:_SUBJECTS])} and {len(named) - _SUBJECTS} more"


def detail_of(text: str, detail: str) -> str:
    """The detail in brackets behind a text, unless the text says the same."""
    same = detail.lower().removeprefix("the ") in text.lower()
    return "" if same else f" ({detail})"


def reason_lines(reasons: Iterable[Reason]) -> Iterator[str]:
    """One line for what is to be mended, with its remedy; below it one for each that follows."""
    for group in grouped(reasons):
        lead = group.lead
        detail = detail_of(lead.text, lead.detail)
        yield f"  {group.subjects}: {lead.text}{detail}; {lead.remedy}"
        for alike in group.follow.values():
            yield f"    from that: {subjects(alike)}: {alike[0].text}"
