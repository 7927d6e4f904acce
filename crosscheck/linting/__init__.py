"""One description alone: findings of what no machine can have, or what readers make different things of."""
