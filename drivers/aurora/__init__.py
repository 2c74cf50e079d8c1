"""The NDI Aurora over a serial line: link, bring_up, tools, then polling for frames; tracker joins
them.
"""
