"""The second step of the scheme: nodal forces P = M (a - g) and joint efforts tau = L T P, with their balances."""
