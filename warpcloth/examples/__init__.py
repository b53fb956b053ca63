"""Examples to run and to read: ``python -m warpcloth.examples.recover_fabric``, ``….throw_onto_target``."""
