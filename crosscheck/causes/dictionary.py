"""The dictionary: all causes, by name."""

from __future__ import annotations

from crosscheck.causes import beam_rows, body_rows, convention_rows, joint_rows
from crosscheck.causes.cause import Cause

DICTIONARY: dict[str, Cause] = {
    cause.name: cause for rows in (joint_rows, body_rows, convention_rows, beam_rows) for cause in rows.ROWS
}
