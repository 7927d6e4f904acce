"""Threads that share one call: helpers, the memory by which they get work, and the processors that they run on.

Who uses it: `rigid.blocks` (one call of a prepared function), `analysis.solve_many` (affinity and `take` alone).  Contract:

1.  A caller never waits for a helper that has not begun.  It does all work itself that nobody has taken; helpers only make a
    call shorter.  Results do not depend on them, to the last bit: every block of samples is computed by the same code.
2.  Blocks are handed out by one counter (`atomics.take`).  Each has one owner, who alone writes its results.
3.  An offer goes through one *mail* (`worker_pool`): FREE, CLAIMED, OFFERED, TAKEN, DONE, FREE.  Only the caller that has
    claimed a mail writes its words; only the helper that has taken it reads them.  A caller collects or withdraws all its offers
    before it returns, also when it is interrupted: no helper works on memory that is given back.
4.  A mail holds addresses of the caller's arrays, so these live until the offer is settled (`worker_pool.collected`).
5.  What a thread wrote before it `put` or `swap` a cell is seen by every thread that then finds the new value by `look` or
    `swap`.
6.  A helper watches its mail for `worker_pool.WATCH` after its last work, then sleeps; it leaves its caller's processor
    (`affinity.leave`).  It is a daemon thread named "flexinv", and is dismissed when the program ends.
7.  A forked child begins without helpers.  Where no thread can be started, those that are there have to do.
8.  Nothing here changes the processors that a thread may use for good: a thread that is moved gets all of them back at once.

The switch: with the environment variable ``FLEXINV_THREADS=n`` no call uses more than n threads, and with 1 there are no
helpers: no thread is started, no mail is watched.  It is read once, when a call first asks.  The argument ``threads`` of
`flexinv.prepare` and `flexinv.solve_many` says the same for one function or one call; the smaller number counts.
"""
