"""Parts that are right, however unusual: nothing may be said of them."""

from __future__ import annotations

import random

import numpy as np

from campaigns.part_faults.draft import Draft, make_draft
from campaigns.part_faults.matrices import make_matrix_draft
from campaigns.part_faults.table import control


@control
def leave_as_it_is(draw: random.Random) -> Draft:
    """Nothing is changed."""
    return make_draft(draw)


@control
def number_with_a_hole(draw: random.Random) -> Draft:
    """Numbers of nodes have a hole, and all cards know it."""
    draft = make_draft(draw)
    draft.numbers = np.where(draft.numbers > 30, draft.numbers + 1000, draft.numbers)
    hub = draft.points[:, 0] < 1e-9
    draft.sets["HUB"] = draft.numbers[hub].tolist()
    return draft


@control
def write_small_letters(draw: random.Random) -> Draft:
    """Abaqus takes cards and names in any case."""
    draft = make_draft(draw)
    draft.edits.append(lambda text: text.lower())
    return draft


@control
def end_lines_as_windows(draw: random.Random) -> Draft:
    """Carriage returns, comments and empty lines."""
    draft = make_draft(draw)
    draft.edits.append(lambda text: ("** from Windows\n\n" + text).replace("\n", "\r\n"))
    return draft


@control
def use_bricks(draw: random.Random) -> Draft:
    """Quadratic bricks."""
    return make_draft(draw, "hexahedron20", (4, 2, 2))


@control
def use_matrices(draw: random.Random) -> Draft:
    """Mass and stiffness in tonnes beside the mesh."""
    return make_matrix_draft(draw)


@control
def use_rubber(draw: random.Random) -> Draft:
    """A soft bushing: 1 MPa and 0.45."""
    draft = make_draft(draw)
    draft.swap("E_Pa = 70e9, nu = 0.3, rho_kg_per_m3 = 2700", "E_Pa = 5e6, nu = 0.45, rho_kg_per_m3 = 1100")
    return draft


@control
def use_foam(draw: random.Random) -> Draft:
    """A rigid foam of 60 kg/m3."""
    draft = make_draft(draw)
    draft.swap("E_Pa = 70e9, nu = 0.3, rho_kg_per_m3 = 2700", "E_Pa = 70e6, nu = 0.3, rho_kg_per_m3 = 60")
    return draft
