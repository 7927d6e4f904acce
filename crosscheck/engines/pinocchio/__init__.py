"""Pinocchio: model, inverse dynamics, loops, certificate, export, replay."""
