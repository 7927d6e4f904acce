"""Reading files: mechanisms and cases in TOML, URDF, samples in CSV.  Numbers come in with units, mistakes go out with advice."""
