"""Base parameters: the combinations of masses, centres, inertias and rotors that torques of a tree can tell, by any motion.

    Y pi = Y_b (B pi),   value B pi(z^),   variance  B T C T^T B^T,   T = d pi / dz at z^

B by `flexinv.base_parameters` in random states of the mechanism.  Their errors are small where those of a link's own numbers are
not: that is what the logs have told.  Source: M. Gautier, W. Khalil, "Direct calculation of minimum set of inertial parameters of
serial robots", IEEE Trans. Robotics and Automation 6 (1990).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosscheck.identification.estimation.fit import TOLD, Fit
from crosscheck.identification.machine import Machine, resolve_value
from crosscheck.identification.parameters import MASS, make_load_place
from crosscheck.identification.pseudo_inertia import NAMES, MassPropertyMap
from crosscheck.identification.responses.response import compute_link_inertias
from flexinv.rigid.torque_regressor import BaseParameters, Regressor, base_parameters, sample_states, torque_regressor
from flexinv.typing import Array

ROTOR = "rotor inertia"
SUFFIX = ".rotor_inertia"  # of its name among the columns of a regressor
SAMPLES = 60  # random states: every column has some hundred rows
NORMAL = 1.6448536269514722  # half width of a 90 % interval, in standard deviations


@dataclass(frozen=True)
class BaseRow:
    """A base parameter: the combination in words, its value with a 90 % interval and the value before [unit].

    identifiable : the logs narrow it to `fit.TOLD` of what was known
    """

    words: str
    unit: str
    value: float
    low: float
    high: float
    before: float
    identifiable: bool


def list_base_rows(machine: Machine, fit: Fit) -> list[BaseRow]:
    """Return the base parameters [unit of each] of a rigid tree of which masses or rotors are free; none of other mechanisms."""
    mechanism = machine.mechanism
    free = any(one.kind in (MASS, ROTOR) for one in machine.space.parameters)
    if not free or not mechanism.is_rigid or mechanism.closures:
        return []
    columns = _choose_columns(machine)
    base = base_parameters(columns)
    value = base.combination @ _list_numbers(machine, columns, fit.z)
    before = base.combination @ _list_numbers(machine, columns, np.zeros_like(fit.z))
    now = _compute_variances(machine, columns, base, fit.z, fit.covariance)
    known = _compute_variances(machine, columns, base, np.zeros_like(fit.z), np.eye(len(fit.z)))
    units = np.array(columns.units)[base.columns]
    return [
        BaseRow(
            words, str(units[k]), float(value[k]), *_find_ends(float(value[k]), float(now[k])), float(before[k]),
            bool(now[k] < TOLD**2 * known[k]),
        )
        for k, words in enumerate(base.expressions)
        if known[k] > 0.0
    ]  # fmt: skip


def _find_ends(value: float, variance: float) -> tuple[float, float]:
    half = NORMAL * float(np.sqrt(variance))
    return value - half, value + half


def _choose_columns(machine: Machine) -> Regressor:
    """The columns of links, and of rotors of joints whose efforts show them."""
    full = torque_regressor(machine.mechanism, *sample_states(machine.mechanism, SAMPLES), drives=True)
    links = len(machine.mechanism.links) * len(NAMES)
    rotors = {f"{name}{SUFFIX}" for name, table in machine.settings.joints.items() if not table.has_link_sensor}
    kept = [k for k, name in enumerate(full.names) if k < links or name in rotors]
    names = tuple(full.names[k] for k in kept)
    return Regressor(full.matrix[:, :, kept], names, tuple(full.units[k] for k in kept), full.values[kept])


def _list_numbers(machine: Machine, columns: Regressor, z: Array) -> Array:
    """The numbers of all columns (columns,) [unit of each] at z (parameters,) [-]."""
    values = machine.space.compute_values(z)
    links = compute_link_inertias(machine.space, machine.mechanism, values).ravel()
    rotors = [resolve_value(machine, values, ROTOR, n.removesuffix(SUFFIX)) for n in columns.names[len(links) :]]
    return np.concatenate([links, rotors])


def _compute_variances(
    machine: Machine, columns: Regressor, base: BaseParameters, z: Array, covariance: Array
) -> Array:
    """Variances (base,) [unit^2] of the combinations at z (parameters,) [-]."""
    slopes = np.zeros((len(columns.names), len(z)))
    where = {one.key: k for k, one in enumerate(machine.space.parameters)}
    loads = [make_load_place(name) for name in machine.space.loads]
    for n, link in enumerate(machine.mechanism.links):
        if link.name in machine.space.factors and link.name not in loads:
            at = [where[MASS, f"{link.name}.{name}"] for name in NAMES]
            errors = np.array([machine.space.parameters[k].error for k in at])
            factor = machine.space.factors[link.name]
            rows = slice(n * len(NAMES), (n + 1) * len(NAMES))
            moved = MassPropertyMap.build_for(factor[None]).compute_slopes((errors * z[at])[None, None])
            slopes[rows, at] = moved[0, 0] * errors
    for n, name in enumerate(columns.names):
        k = where.get((ROTOR, name.removesuffix(SUFFIX))) if name.endswith(SUFFIX) else None
        if k is not None:
            one = machine.space.parameters[k]
            slopes[n, k] = one.error * one.compute_value(float(z[k]))
    both = base.combination @ slopes
    return np.asarray(np.einsum("bp,pq,bq->b", both, covariance, both))
