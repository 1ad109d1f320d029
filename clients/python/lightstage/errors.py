"""What can go wrong, as exceptions: a refusal has a number for programs and a sentence for people."""
import enum


class Number(enum.IntEnum):
    """The numbers of a refusal; they never change. Its hundred is its class: 1xx the request is
    wrong, 2xx the moment or the name, 3xx the rig, 4xx storage, 5xx the daemon."""

    BAD_FRAME = 100
    BAD_VERSION = 101
    UNKNOWN_TYPE = 102
    MESSAGE_TOO_BIG = 103
    BAD_MESSAGE = 104
    NO_HELLO = 105
    TOO_MANY = 106
    BAD_ARGUMENT = 107
    UNSUPPORTED = 108
    OVER_LIMIT = 109
    NOT_ALLOWED = 110
    WRONG_STATE = 200
    BUSY = 201
    NOT_FOUND = 202
    EXISTS = 203
    CANCELLED = 204
    ABORTED = 205
    RIG_CHANGED = 206
    CLOSING = 207
    RIG_GONE = 300
    RIG_TIMEOUT = 301
    RIG_REFUSED = 302
    RIG_LIMIT = 303
    RIG_MISMATCH = 304
    STORAGE = 400
    STORAGE_FULL = 401
    DAMAGED = 402
    INCOMPLETE = 403
    INTERNAL = 500
    NO_MEMORY = 501
    SYSTEM = 502


class Error(Exception):
    """Whatever this package raises of its own."""


class Lost(Error):
    """There is no connection, or there is none any more. A take goes on without it."""


class Refused(Error):
    """The daemon said no. `number` is a Number (or an int that this version does not know),
    `sentence` says what, where, expected, found and what to do."""

    def __init__(self, number: int, sentence: str):
        known = number in Number._value2member_map_
        self.number: int = Number(number) if known else number
        self.sentence = sentence
        name = Number(number).name.lower().replace("_", " ") if known else "error"
        super().__init__(f"{sentence} ({number} {name})")
