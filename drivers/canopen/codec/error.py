"""The one error that decoding and encoding raise."""


class CodecError(ValueError):
    """Bytes that are not what the service sends, or a value that it cannot send."""
