"""The daemon's side: questions and set-points in, answers and telemetry out, and STOP on its own
way.
"""
