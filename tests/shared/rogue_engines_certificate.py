"""What the engines of ``rogue_engines`` say of their own models: one has a tenth more mass, the others cannot be asked."""

from __future__ import annotations

from dataclasses import replace

from crosscheck.engines.pinocchio import certificate as pinocchio_certificate
from crosscheck.measures.certificate import Certificate
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    if engine != "heavy":
        raise InputError("this formulation has nothing to be asked for")
    good = pinocchio_certificate.certify(mechanism, case, engine)
    return replace(good, mass=1.1 * (good.mass or 0.0))
