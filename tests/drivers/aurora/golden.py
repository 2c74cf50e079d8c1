"""Bytes of the Combined API that were worked out by hand and confirmed by an independent client."""

from drivers.aurora.codec.status_bits import HandleState
from drivers.aurora.codec.tracking_data import ToolReading, TrackingData

COMMANDS = {
    "APIREV:": "443E",
    "BEEP:1": "8404",
    "BX:0001": "C26D",
    "BX:0801": "00EC",
    "COMM:00000": "0084",
    "COMM:50000": "0048",
    "COMM:60000": "000C",
    "COMM:A0000": "0BF8",
    "INIT:": "E3A5",
    "PENA:0AD": "AD1E",
    "PENA:0BD": "5D1E",
    "PHF:0A": "2B0D",
    "PHINF:0A0001": "04ED",
    "PHINF:0A0085": "07EB",
    "PHSR:00": "20FF",
    "PHSR:01": "E03E",
    "PHSR:02": "E17E",
    "PHSR:03": "21BF",
    "PHSR:04": "E3FE",
    "PINIT:0A": "D5EB",
    "PINIT:0B": "D4AB",
    "RESET:": "3F7E",
    "RESET:0": "34BF",
    "SFLIST:03": "500F",
    "TSTART:": "5423",
    "TSTART:40": "1B0E",
    "TSTART:80": "1B0B",
    "TSTOP:": "2C14",
    "TX:0001": "031A",
    "TX:0801": "C19B",
    "VER:0": "65EE",
    "VER:5": "662E",
    "GET:Device.*": "722D",
    "GETINFO:Features.Firmware.Version": "0492",
}
"""What a checksum covers, and the checksum."""

REPLIES = {
    "OKAY": "A896",
    "RESET": "BE6F",
    "ERROR01": "6BC2",
    "ERROR04": "6802",
    "ERROR0C": "4E42",
    "ERROR10": "3B02",
    "ERROR13": "3A42",
    "ERROR2B": "EE82",
    "00": "1414",
    "010A001": "C1B5",
    "020A0010B001": "C53E",
    "020A0110B011": "952F",
    "020A0310B031": "350D",
    "018": "4D14",
    "1": "D4C1",
}

TOOL_A = ToolReading(
    0x0A,
    HandleState.VALID,
    (0.5, 0.5, -0.5, 0.5),
    (12.5, -30.25, -200.0),
    0.0625,
    0x31,
    0x140,
)
TOOL_B = ToolReading(
    0x0B, HandleState.VALID, (1.0, 0.0, 0.0, 0.0), (0.0, 45.75, -150.5), 0.0, 0x31, 0x140
)
MISSING_B = ToolReading(0x0B, HandleState.MISSING, None, None, 0.0, 0x71, 0x148)
DISABLED_C = ToolReading(0x0C, HandleState.DISABLED)

V0 = TrackingData((), 0)
V1 = TrackingData((TOOL_A, TOOL_B), 0)
V2 = TrackingData((TOOL_A, MISSING_B), 0)
V3 = TrackingData((TOOL_A, MISSING_B, DISABLED_C), 0x0080)

_A = (
    "0A 01 00 00 00 3F 00 00 00 3F 00 00 00 BF 00 00 00 3F 00 00 48 41 00 00 F2 C1 00 00 48 C3"
    "00 00 80 3D 31 00 00 00 40 01 00 00"
)
_B = (
    "0B 01 00 00 80 3F 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 37 42 00 80 16 C3"
    "00 00 00 00 31 00 00 00 40 01 00 00"
)
_B_MISSING = "0B 02 71 00 00 00 48 01 00 00"

BX = {
    "no handles": (bytes.fromhex("C4 A5 03 00 2D E3 00 00 00 00 00"), V0),
    "both valid": (bytes.fromhex(f"C4 A5 57 00 13 23 02 {_A} {_B} 00 00 B6 E4"), V1),
    "one missing": (bytes.fromhex(f"C4 A5 37 00 3B 23 02 {_A} {_B_MISSING} 00 00 CC 58"), V2),
    "one disabled": (
        bytes.fromhex(f"C4 A5 39 00 3F 43 03 {_A} {_B_MISSING} 0C 04 80 00 48 E8"),
        V3,
    ),
}

_A_TEXT = "0A+05000+05000-05000+05000+001250-003025-020000+006250000003100000140\n"
_B_TEXT = "0B+10000+00000+00000+00000+000000+004575-015050+000000000003100000140\n"

TX = {
    "both valid": (f"02{_A_TEXT}{_B_TEXT}0000006C\r".encode(), V1),
    "one missing": (f"02{_A_TEXT}0BMISSING0000007100000148\n00008E14\r".encode(), V2),
    "one disabled": (
        f"03{_A_TEXT}0BMISSING0000007100000148\n0CDISABLED\n0080A720\r".encode(),
        V3,
    ),
}

VOLUME = b"19-025000+025000-025000+025000-055000-005000+000000+000000+000000+00000000\n529A\r"
IDENTITY = b"02000000NDI         0013C112801314F8D\r"
