"""What is done beside a running daemon, which never imports it: experiments, studies, reports,
models.
"""
