"""FMUs of a mechanism whose closures come and go: an input says which of them act."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from c_library import needs_compiler
from fmu_driver import driven, needs_fmpy

import flexinv
from flexinv.errors import InputError
from flexinv.export.acting_sets import list_acting_sets
from flexinv.export.rigid.closed_samples import list_closed_samples
from flexinv.kinematics.mesh import build

pytestmark = [needs_compiler, needs_fmpy]


@pytest.mark.parametrize("fmi", ["3.0", "2.0"])
def test_each_set_of_closures_has_the_digits_of_a_mechanism_that_has_it_alone(tmp_path: Path, fmi: str) -> None:
    """A number that is none of a set is a step that is discarded, and the next one works."""
    m = flexinv.load_mechanism("models/two_arms")
    file = flexinv.export_fmu(m, tmp_path / "arms.fmu", fmi=fmi)
    names = [f"{n}.q" for n in m.coordinate_names] + [f"{n}.{p}" for p in ("qd", "qdd") for n in m.velocity_names]
    driven_rates = np.flatnonzero(m.actuated)
    asked = [f"{m.velocity_names[i]}.tau" for i in driven_rates]
    sets = list_acting_sets(m)
    assert len(sets) > 2
    efforts = list[float]()
    with driven(file) as fmu:
        assert f"2 {sets[2].name}" in next(v for v in fmu.description.modelVariables if v.name == "phase").description
        fmu.begin({})
        time = 0.0
        for number, one in enumerate(sets):
            expects = flexinv.prepare(one.mechanism, threads=1)
            for sample in islice(list_closed_samples(build(one.mechanism), m.neutral), 3):
                row = dict(zip(names, np.concatenate(sample), strict=True))
                for wrong in (0.5, -1.0, float(len(sets)), float("nan"), 1e300):
                    fmu.set(row | {"phase": wrong})
                    with pytest.raises(Exception, match="failed with status 2"):
                        fmu.step(time, 0.1)
                fmu.set({"phase": number})
                fmu.step(time, 0.1)
                time += 0.1
                expected = expects.sample(*sample, np.zeros(m.nv))[driven_rates]
                assert np.array_equal(fmu.get(*asked), expected)
                efforts.append(float(expected[0]))
    assert len(set(efforts)) > len(sets)


def test_torques_that_move_such_a_mechanism_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"closures that act for a while \('lies', .*a forward FMU has no call"):
        flexinv.export_fmu(flexinv.load_mechanism("models/two_arms"), tmp_path / "x.fmu", kind="forward", step=1e-3)
    assert not list(tmp_path.iterdir())
