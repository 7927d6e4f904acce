"""Speed: flexinv beside other engines on the same work, in one process, in turns.

Every part is a study (a table of the report made in a process of its own); its rows carry the ratios that have limits.

    cores       availability of whole cores
    timing      calls in turns, repetitions in which the process was not interrupted, medians and quartiles
    targets     speed targets on this machine, and the measured values; the ratios for the history
    rigid       torques of many samples
    single      torques of one sample, of the first call; longer chains
    loop_chains chains of closed loops: growth with their number
    latency     cycles of a controller, one call each, as a histogram
    flexible    arms that bend: time beside error
    marches     finer meshes, closed loops beside trees of the same size, many scenarios over threads
    parts       all of these as studies, one after the other
"""
