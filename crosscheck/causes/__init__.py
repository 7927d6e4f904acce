"""Causes of differences between two engines: a dictionary, fitted to the difference of their torques.

A cause is a change of an engine's input (`subject.Subject`: mechanism, case, options, and changes of the efforts that it
gives), with a size.  Its column is the change of flexinv's own torques; no formula is written down for it.

To add a cause, add a row `cause.Cause` to one of the tables, `joints`, `bodies`, `conventions`, `beams`:

    Cause("payload", "{target} carries {size} more at its tip", _payload, _carriers, 1, mass, "kg", shows=HOLD)

that is: its name; a sentence; a function (subject, target, size) -> subject, with size 0 the subject itself; where it can
sit; how many numbers its size has (0: it is there or not); a size that matters; its unit; the motion that shows it.
``crosscheck selftest`` then plants it in an engine wherever it can sit, and says whether it is found.
"""
