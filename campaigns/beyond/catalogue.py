"""All mistakes, and which of them are made in a campaign: drawn by lot from a seed, every kind before any twice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.beyond import bodies, drives, inside, kinematics, loops, sections, signals
from campaigns.beyond.fault import Fault, FaultScenario, Recipe, draw_one, join_faults
from flexinv.typing import Array

RECIPES: tuple[Recipe, ...] = tuple(
    recipe
    for chapter in (bodies, drives, kinematics, loops, sections, signals, inside)
    for recipe in chapter.CHAPTER.recipes
)
PAIRS = 0.1  # of all faults are two at once
FAINT = 0.3  # as often as any other size is one drawn that only shows that nothing is said below the bars
TRIES = 40  # scenes in which a recipe may find nothing to get wrong before it is passed over


@dataclass(frozen=True)
class DrawnFault:
    """One fault of a campaign: its number, where, which recipes, and the seed that makes it again.

    scene : number of the mechanism and engine; recipes : numbers in ``RECIPES``, two of them for two faults at once
    sizes : number of the size of each
    """

    number: int
    scene: int
    recipes: tuple[int, ...]
    sizes: tuple[int, ...]
    seed: int

    @property
    def name(self) -> str:
        """The names of its recipes."""
        return " + ".join(RECIPES[k].name for k in self.recipes)

    @property
    def topic(self) -> str:
        """The topics of its recipes."""
        return " + ".join(dict.fromkeys(RECIPES[k].topic for k in self.recipes))


def make_fault(drawn_fault: DrawnFault, scenario: FaultScenario) -> Fault | None:
    """Return the fault itself, the same one every time; None where the scene has nothing to get wrong so."""
    faults = []
    for k, (recipe, size) in enumerate(zip(drawn_fault.recipes, drawn_fault.sizes, strict=True)):
        rng = np.random.default_rng([drawn_fault.seed, drawn_fault.number, k])
        faults.append(RECIPES[recipe].draw(scenario, rng, RECIPES[recipe].sizes[size]))
    known = [fault for fault in faults if fault is not None]
    if len(known) < len(faults):
        return None
    return known[0] if len(known) == 1 else join_faults(*known)


def draw(scenes: Sequence[FaultScenario], weights: Sequence[float], count: int, seed: int) -> list[DrawnFault]:
    """Return so many faults: recipes in turns, each in a scene by lot where it finds something to get wrong.

    weights : of the scenes [-]; a scene that took a fault is drawn again only when the others had theirs
    """
    rng = np.random.default_rng(seed)
    chance = np.array(weights, dtype=float) / np.sum(weights)
    taken = np.zeros(len(scenes))
    result: list[DrawnFault] = []
    for recipe in _draw_recipe_order(rng):
        if len(result) >= count:
            break
        two = rng.random() < PAIRS
        other = (int(rng.integers(len(RECIPES))),) if two else ()
        for _ in range(TRIES):
            scene = int(draw_one(rng, _draw_candidates(chance, taken, rng)))
            recipes = (recipe, *other)
            sizes = tuple(_draw_size_number(RECIPES[k], rng) for k in recipes)
            one = DrawnFault(len(result) + 1, scene, recipes, sizes, seed)
            if make_fault(one, scenes[scene]) is not None:
                result.append(one)
                taken[scene] += 1.0
                break
    return result


def _draw_size_number(recipe: Recipe, rng: np.random.Generator) -> int:
    """The number of a size by lot: the first of three or more is hardly to be seen, and less often drawn."""
    chance = np.ones(len(recipe.sizes))
    if len(chance) > 2:
        chance[0] = FAINT
    return int(rng.choice(len(chance), p=chance / chance.sum()))


def _draw_recipe_order(rng: np.random.Generator) -> Iterator[int]:
    """Every recipe once in an order by lot, and again, without end."""
    while True:
        yield from (int(k) for k in rng.permutation(len(RECIPES)))


def _draw_candidates(chance: Array, taken: Array, rng: np.random.Generator) -> list[int]:
    """Scenes to choose from: three by lot after their weights, those preferred that are behind their share."""
    behind = chance * (taken.sum() + 1.0) - taken
    weights = chance * np.exp(np.clip(behind, -2.0, 2.0))
    return [int(k) for k in rng.choice(len(chance), min(3, len(chance)), replace=False, p=weights / weights.sum())]
