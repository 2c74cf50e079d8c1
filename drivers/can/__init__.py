"""The bus itself: frames, interfaces, budget, capture files. Nothing here knows CANopen."""
