"""Exudyn: kinematic trees and beams in time, loops, phases, certificate, export, replay."""
