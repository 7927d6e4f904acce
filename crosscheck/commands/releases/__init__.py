"""Commands about releases of packages: what changed between them."""
