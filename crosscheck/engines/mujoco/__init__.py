"""MuJoCo: model, inverse dynamics, loops, its flex, certificate, export, replay."""
