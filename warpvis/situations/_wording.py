# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Wordings of questions, answers and reasons."""

from __future__ import annotations

YES, NO = "yes", "no"
LEFT, RIGHT = "left", "right"
NEITHER = "neither of them"
BOTH = "both of them"
NEVER = "never"
AMOUNTS = ("none of it", "less than half of it", "more than half of it")

WORDINGS: dict[str, tuple[str, ...]] = {
    "sees": (
        "Can {agent} see {thing}?",
        "Is {thing} visible to {agent}?",
        "From where {agent} is, and looking as {agent} does, is {thing} in sight?",
        "Does {agent} have a view of {thing}?",
    ),
    "how_much": (
        "How much of {thing} can {agent} see?",
        "Which part of {thing} is visible to {agent}?",
        "What share of {thing} is in sight for {agent}?",
    ),
    "why_not": (
        "Why can {agent} not see {thing}?",
        "What keeps {agent} from seeing {thing}?",
        "For which reason is {thing} not visible to {agent}?",
    ),
    "left_right": (
        "From the point of view of {agent}, is {thing} to the left or to the right of {other}?",
        "As {agent} sees it, on which side of {other} is {thing}?",
        "Seen by {agent}, is {thing} left or right of {other}?",
    ),
    "nearer": (
        "Which one is nearer to {agent}: {thing} or {other}?",
        "Is {thing} or {other} closer to {agent}?",
        "Of {thing} and {other}, which one is at a smaller distance from {agent}?",
    ),
    "without": (
        "If {blocker} were taken away, could {agent} see {thing}?",
        "Suppose that {blocker} is removed: is {thing} then visible to {agent}?",
        "Would {thing} be in sight for {agent} without {blocker}?",
    ),
    "step": (
        "If {agent} took a step of {meters} m to the {side}, looking in the same direction, could {agent} see {thing}?",
        "{agent} moves {meters} m to the {side} and keeps looking in the same direction. Is {thing} then in sight?",
        "Would {thing} be visible to {agent} from {meters} m farther to the {side}?",
    ),
    "stand": (
        "Next to what would {agent} have to stand to see {thing}?",
        "{agent} wants to look at {thing}. Which place is right for that?",
        "From next to which of these is {thing} visible to {agent}?",
    ),
    "meant": (
        "{agent} asks for the {category} in view. Which one is meant?",
        "{agent} says: “Please give me the {category}.” Which one does {agent} see?",
        "Which {category} can {agent} mean, if {agent} sees only one of them?",
    ),
    "who": (
        "Who can see {thing}: {agent} or {second}?",
        "{agent} and {second}: which of them has {thing} in sight?",
        "To whom is {thing} visible, {agent} or {second}?",
    ),
    "when": (
        "In which picture does {agent} see {thing} for the first time?",
        "The pictures are in order. Which is the first one in which {thing} is visible to {agent}?",
        "When does {agent} first have {thing} in sight?",
    ),
    "belief": (
        "{thing} was moved between the pictures. Where does {agent} believe that it is?",
        "Where will {agent} look for {thing}?",
        "Judging by what {agent} saw, where does {agent} expect {thing}?",
    ),
}
"""Wordings by kind of question, the first one as its text, and the others as paraphrases."""

_STATES = {
    "out_of_view": "it is outside the field of view of {agent}",
    "too_far": "it is too far away for {agent}",
    "too_near": "it is too near for {agent}",
    "occluded": "{blocker} hides it from {agent}",
}


def word_questions(kind: str, **words: str) -> tuple[str, ...]:
    """Return all wordings of a question, each a sentence that begins with a capital letter."""
    return tuple(_sentence(wording.format(**words)) for wording in WORDINGS[kind])


def word_state(state: str, agent: str, blocker: str = "") -> str:
    """Return why something is not seen, as a part of a sentence."""
    return _STATES[state].format(agent=agent, blocker=blocker or "something")


def word_share(fraction: float) -> str:
    """Return a visible share in words: ``"38 % of it"``, and ``"nothing of it"`` for less than half a percent."""
    return "nothing of it" if fraction < 0.005 else f"{100 * fraction:.0f} % of it"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
