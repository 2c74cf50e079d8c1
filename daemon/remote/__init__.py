"""What both ends of the wire share: keys, payloads, access, discovery."""
