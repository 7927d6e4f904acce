"""Compiled models of MuJoCo: names of their parts, tendons and equalities, and features that no mechanism can say."""
