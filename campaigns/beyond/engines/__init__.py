"""Built models of other engines with a mistake in them."""
