"""crosscheck: one mechanism in several engines, each built from primary data, compared quantity by quantity and judged."""
