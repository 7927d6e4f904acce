"""The C library of `flexinv.export_c` as an engine: what stands in the field goes through the same comparisons."""
