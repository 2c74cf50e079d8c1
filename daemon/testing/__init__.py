"""Tracking tests for users: a pytest plug-in, and the laboratories that its fixtures give.

`pytest_plugin` imports pytest alone; all else comes when a fixture is used first.
"""
