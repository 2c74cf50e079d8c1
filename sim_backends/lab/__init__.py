"""The emulated laboratory: body, devices and buses wired to each other, and its ports for other
processes.
"""
