"""Offers of work from one thread to another, in memory that both watch: a helper begins some hundred nanoseconds later.

A *mail* is a row of cells (`atomics`).  Its state goes round:

    FREE  -> CLAIMED   a caller is writing an offer
          -> OFFERED   ... which a helper may take, or the caller withdraw
          -> TAKEN     a helper works on it
          -> DONE      ... and has left its answer, which the caller collects
          -> FREE
"""

from __future__ import annotations

from flexinv.kernels.jit import jit_lanes
from flexinv.kernels.threads.atomics import address, look, pause, put, swap

FREE, CLAIMED, OFFERED, TAKEN, DONE = range(5)
# Cells of a mail, in lines of the cache of eight: the state, what only the caller writes, whether the helper sleeps, the offer.
STATE, OWNER, SLEEPS, ANSWER, WORDS = 0, 8, 16, 24, 32
CELLS = 64
# Looks after which a caller that waits for a helper lets the system run others: some hundred microseconds.
LOOKS = 10_000


@jit_lanes
def claimed(mail, owner):
    """Claim a mail; return True [-] if it was free: its new owner then writes the words of an offer and makes it."""
    if look(mail, STATE) != FREE or not swap(mail, STATE, FREE, CLAIMED):
        return False
    mail[OWNER] = owner
    return True


@jit_lanes
def write(mail, number, array):
    """Write where an array begins and how long it is [-], as word ``number`` of an offer."""
    mail[WORDS + 2 * number], mail[WORDS + 2 * number + 1] = address(array), array.size


@jit_lanes
def awaited(mail, patience):
    """Wait for an offer, for at most so many looks [-]; return True if it was taken."""
    for _ in range(patience):
        if look(mail, STATE) == OFFERED and swap(mail, STATE, OFFERED, TAKEN):
            return True
        pause()
    return False


@jit_lanes
def settled(mails, owner, total):
    """Add the answers to the owner's offers to total[0] and withdraw what nobody took [-]; return whether all are settled.

    False where a helper still works after `LOOKS`: ask again.
    """
    for i in range(mails.shape[0]):
        mail = mails[i]
        if look(mail, OWNER) != owner:
            continue
        if not swap(mail, STATE, OFFERED, CLAIMED):
            left = LOOKS
            while look(mail, STATE) != DONE:
                pause()
                left -= 1
                if left == 0:
                    return False
            total[0] += mail[ANSWER]
        mail[OWNER] = 0
        put(mail, STATE, FREE)
    return True
