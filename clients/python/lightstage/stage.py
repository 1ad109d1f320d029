"""The verbs: what a client may ask of a light stage."""
import json
import os
import secrets
from typing import Any, Dict, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from . import connection as wire
from . import lightstage_pb2 as messages
from .arrays import Array, light_numbers
from .connection import Connection, open_socket, tls_context
from .factored import Factored, gather
from .field import Bands, Field, Picture, number, region_message, sample_of
from .relit import Canvas, Relit, Weights, rows_of
from .ring import Ring
from .tiles import Shared, Tiles, shared_pictures

NAME = "python lightstage"
AHEAD_BYTES = 64 << 20  # of an iterator: what the daemon may send before it is asked for


class Rig(NamedTuple):
    name: str
    channels: List[messages.RigChannel]
    cameras: List[messages.RigCamera]
    positions_m: Array  # float32 [n_lights][3]: right, up, towards the front


class Preview(NamedTuple):
    report: messages.PreviewReply
    pixels: Array  # uint8 [height][width][3], sRGB


def connect(address: Optional[str] = None, *, certificate: Optional[str] = None,
            key: Optional[str] = None, authority: Optional[str] = None,
            timeout: Optional[float] = None) -> "Stage":
    """A connection to a daemon; use it in `with`, or close() it.

    `address`: the path of its Unix socket; or tls://HOST[:PORT], which needs the PEM files
    `certificate` and `key` (who we are) and `authority` (who vouches for the daemon). Without it the
    environment says, as for lightstagectl: LIGHTSTAGED_SERVER, else LIGHTSTAGED_SOCKET, else
    /run/lightstaged/socket; LIGHTSTAGED_CERTIFICATE, _KEY and _AUTHORITY name the files. `timeout`:
    seconds of silence after which a call raises TimeoutError; None: it waits. Raises Lost where
    nobody answers, Refused where the daemon will not have us."""
    env = os.environ.get
    where = (address or env("LIGHTSTAGED_SERVER") or env("LIGHTSTAGED_SOCKET")
             or wire.DEFAULT_SOCKET)
    files = (certificate or env("LIGHTSTAGED_CERTIFICATE"), key or env("LIGHTSTAGED_KEY"),
             authority or env("LIGHTSTAGED_AUTHORITY"))
    context = tls_context(*files) if where.startswith("tls://") else None
    return Stage(Connection(open_socket(where, context, timeout), timeout, NAME))


class Stage:
    """A connected daemon. Every call may raise Refused (with number and sentence) or Lost.

    A call that an exception ends, Ctrl-C among them, is cancelled in the daemon, and the connection
    goes on. So is an iterator that is left early, once it is closed. Iterators may overlap each other
    and other calls; a thread needs a connection of its own."""

    def __init__(self, connected: Connection):
        self._connection = connected
        self.hello = connected.hello
        self.capabilities = frozenset(connected.hello.capabilities)

    def close(self) -> None:
        self._connection.close()

    def __enter__(self) -> "Stage":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def _ask(self, kind: int, message: Any, payload: bytes = b"") -> Any:
        return self._connection.ask(kind, message, payload).message

    # ---- the rig ----

    def status(self) -> messages.StatusReply:
        """What is connected, what runs, which privileges are missing."""
        return self._ask(wire.STATUS, messages.Status())

    def rig(self) -> Rig:
        """Lights, channels and cameras as configured."""
        reply, payload, _ = self._connection.ask(wire.RIG, messages.Rig())
        positions = np.frombuffer(payload, "<f4").reshape(reply.n_lights, 3)
        return Rig(reply.name, list(reply.channels), list(reply.cameras), positions)

    def metrics(self) -> messages.MetricsReply:
        """What was counted since the daemon started."""
        return self._ask(wire.METRICS, messages.Metrics())

    def blank(self) -> None:
        """All lights off, now; ends a running take."""
        self._ask(wire.BLANK, messages.Blank())

    def preview(self, camera: int = 0, *, exposure_us: float = 0, channel: str = "",
                level: float = 0.1) -> Iterator[Preview]:
        """What a camera sees, at most ten a second, until the iterator is closed. With
        `exposure_us` the camera runs freely, under steady light of `channel`, if one is named, at
        `level` of its strength; without, these are frames of takes as they are made."""
        ask = messages.Preview(camera=camera, exposure_us=exposure_us, channel=channel,
                               level=level if channel else 0)
        with self._connection.request(wire.PREVIEW, ask) as request:
            for reply, payload, _ in request:
                yield Preview(reply, np.frombuffer(payload, np.uint8).reshape(
                    reply.height, reply.width, 3))

    def ring(self, camera: int = 0) -> Ring:
        """What a camera's frames land in while a take runs (else Refused, 200), in the daemon's own
        memory: an operator's, on its Unix socket alone."""
        answer = self._connection.ask(wire.RING, messages.Ring(camera=camera))
        return Ring(answer.message, answer.fds)

    # ---- takes ----

    def preflight(self, plan: str) -> messages.PreflightReply:
        """What a plan would cost, and whether rig and disk allow it."""
        return self._ask(wire.PREFLIGHT, messages.Preflight(), plan.encode())

    def start(self, name: str, plan: str, token: Optional[str] = None) -> messages.TakeStatus:
        """Begin a take, the text of its plan given. It runs on whatever becomes of this client. The
        same token again starts nothing, and follows what it had started (after a lost connection);
        without one a new one is made up, .token of what is returned."""
        reply = self._ask(wire.TAKE_START, messages.TakeStart(
            name=name, token=token or secrets.token_hex(16)), plan.encode())
        return reply.take

    def resume(self, take: str, token: Optional[str] = None) -> messages.TakeStatus:
        """Photograph what a take on disk lacks."""
        return self._ask(wire.TAKE_RESUME, messages.TakeResume(
            take=take, token=token or secrets.token_hex(16))).take

    def abort(self) -> None:
        """End the running take; it keeps what is stored."""
        self._ask(wire.TAKE_ABORT, messages.TakeAbort())

    def progress(self, token: str = "") -> Iterator[messages.TakeStatus]:
        """Where a take stands, as it changes and ten times a second, until it has ended: the last
        says how. `token`: of that take; without, of whatever runs or ran last."""
        with self._connection.request(wire.TAKE_PROGRESS,
                                      messages.TakeProgress(token=token)) as request:
            for answer in request:
                yield answer.message

    def events(self, *, progress: bool = False, published: bool = False,
               alarms: bool = False) -> Iterator[messages.EventsReply]:
        """What happens, as it does, until the iterator is closed: the progress of takes, pictures
        that may be fetched from now on, alarms. None named: all of them."""
        ask = messages.Events(progress=progress, published=published, alarms=alarms)
        with self._connection.request(wire.EVENTS, ask) as request:
            for answer in request:
                yield answer.message

    def follow(self, take: messages.TakeStatus) -> messages.TakeStatus:
        """Wait for the end of a take that start() or resume() began; how it ended."""
        for take in self.progress(take.token):
            pass
        return take

    def takes(self) -> List[messages.TakeSummary]:
        """What is on disk, oldest first."""
        with self._connection.request(wire.TAKE_LIST, messages.TakeList()) as request:
            return [take for answer in request for take in answer.message.takes]

    def summary(self, take: str) -> messages.TakeSummary:
        return self._ask(wire.TAKE_SHOW, messages.TakeShow(take=take)).summary

    def show(self, take: str) -> Dict[str, Any]:
        """take.json: rig, plan, calibration and all else that is known of a take."""
        payload = self._connection.ask(wire.TAKE_SHOW, messages.TakeShow(take=take)).payload
        document: Dict[str, Any] = json.loads(bytes(payload))
        return document

    def verify(self, take: str) -> messages.TakeVerifyReply:
        """Read every picture back and hold every shot against the plan."""
        return self._ask(wire.TAKE_VERIFY, messages.TakeVerify(take=take))

    def slate(self, take: str, **changes: Any) -> messages.Slate:
        """What is written down about a take, after these changes: slate, scene, take_number, circled,
        timecode, notes."""
        if "take_number" in changes:
            changes["take"] = changes.pop("take_number")
        ask = messages.TakeSlate(take=take)
        if changes:
            ask.write.CopyFrom(messages.Slate(**changes))
            ask.fields.extend(messages.Slate.DESCRIPTOR.fields_by_name[name].number
                              for name in changes)
        return self._ask(wire.TAKE_SLATE, ask).slate

    # ---- pictures ----

    def _fetch(self, take: str, channel: str, lights: Optional[Tuple[int, ...]],
               region: Optional[Sequence[int]], model: Any, layout: Any, quantity: Any, dtype: Any,
               **others: Any) -> messages.Fetch:
        promotion = others.pop("promotion", None) or messages.Promotion(
            model=number(messages.Model, model))
        ask = messages.Fetch(
            take=take, channel=channel, lights=lights or (), region=region_message(region),
            layout=number(messages.Layout, layout), quantity=number(messages.Quantity, quantity),
            sample=sample_of(dtype), **others)
        ask.promotion.CopyFrom(promotion)
        return ask

    def pictures(self, take: str, channel: str = "", *, lights: Optional[Iterable[int]] = None,
                 region: Optional[Sequence[int]] = None, model: Any = "measured",
                 layout: Any = "mosaic", quantity: Any = "reflectance", dtype: Any = np.float32,
                 **others: Any) -> Iterator[Picture]:
        """Pictures one after the other, each in an array of its own; as fetch()."""
        ask = self._fetch(take, channel, light_numbers(lights), region, model, layout, quantity,
                          dtype, **others)
        ask.credit_bytes = ask.credit_bytes or AHEAD_BYTES
        bands = Bands()
        with self._connection.request(wire.FETCH, ask, room=bands.room) as request:
            yield from bands.pictures(request)

    def fetch(self, take: str, channel: str = "", *, lights: Optional[Iterable[int]] = None,
              region: Optional[Sequence[int]] = None, model: Any = "measured",
              layout: Any = "mosaic", quantity: Any = "reflectance", dtype: Any = np.float32,
              out: Optional[Array] = None, **others: Any) -> Field:
        """Pictures of single lights under a spectrum, all in one array.

        `lights`: rows of the rig, from 0; None: all that were photographed. `region`: (x, y, width,
        height). `model`: "measured", "sphere", "headlight", "separated", "linear": how a spectrum
        comes to a light; all but the first want `layout` "rgb". `quantity`: "reflectance" or
        "estimate", as stored. `dtype`: float32 or float16. `out`: an array [n][height][width]
        [components] that the pictures are received into. Other words are those of messages.Fetch:
        camera, promotion (in place of model), full_sphere, conditions, variance, validity, level, and,
        in place of `channel`, spectra: each light comes under one after the other."""
        ask = self._fetch(take, channel, light_numbers(lights), region, model, layout, quantity,
                          dtype, **others)
        bands = Bands(self._most(ask) if out is None else len(out), out)
        with self._connection.request(wire.FETCH, ask, room=bands.room) as request:
            pictures = list(bands.pictures(request))
        return Field(bands.whole["pixels"][:len(pictures)], pictures)

    def fetch_factored(self, take: str, spectra: Sequence[str], *,
                       lights: Optional[Iterable[int]] = None,
                       region: Optional[Sequence[int]] = None, model: Any = "sphere",
                       **others: Any) -> Factored:
        """What lights under these spectra are made of, by "sphere" or "headlight": N lights under S
        spectra in N + S pictures."""
        ask = self._fetch(take, "", light_numbers(lights), region, model, "rgb", "reflectance",
                          np.float16, factored=True, spectra=spectra, **others)
        bands = Bands()
        with self._connection.request(wire.FETCH, ask, room=bands.room) as request:
            return gather(list(bands.pictures(request)))

    def _most(self, ask: messages.Fetch) -> int:
        """Pictures that may come."""
        lights = 1 if ask.full_sphere else len(ask.conditions or ask.lights)
        return (lights or self.summary(ask.take).n_lights) * max(1, len(ask.spectra))

    def fetch_tiles(self, tiles: Tiles, take: str, channel: str = "", *,
                    lights: Optional[Iterable[int]] = None, region: Optional[Sequence[int]] = None,
                    model: Any = "measured", layout: Any = "mosaic", quantity: Any = "reflectance",
                    dtype: Any = np.float32, resume: bool = False, max_error: float = 0,
                    **others: Any) -> None:
        """Fill `tiles` with pictures as fetch() has them. What it holds already, from the same request
        before, comes again only where it has changed. `resume`: go on where a call ended early,
        after a lost connection, and do not look at what is there. `max_error`: tiles of which no value
        is farther from 0 are left out, and are 0."""
        ask = self._fetch(take, channel, light_numbers(lights), region, model, layout, quantity,
                          dtype, tiles=True, max_error=max_error, **others)
        n = len(tiles.pixels) or self._most(ask)
        hashes = tiles.hashes.reshape(-1)[:self.hello.max_payload_bytes // 8]
        if resume:
            ask.first_tile, hashes = tiles.missing, hashes[:0]
            if tiles.missing and tiles.missing == tiles.hashes.size:
                return

        def room(reply: messages.FetchReply, n_bytes: int) -> List[memoryview]:
            return tiles.room(ask, n, reply)
        with self._connection.request(wire.FETCH, ask, hashes.tobytes(), room) as request:
            tiles.fill(request)

    def shared(self, take: str, channel: str = "", *, lights: Optional[Iterable[int]] = None,
               region: Optional[Sequence[int]] = None, model: Any = "measured",
               layout: Any = "mosaic", quantity: Any = "reflectance", dtype: Any = np.float32,
               **others: Any) -> Iterator[Shared]:
        """Pictures one after the other, in the daemon's memory: nothing is copied. On its Unix socket
        alone."""
        ask = self._fetch(take, channel, light_numbers(lights), region, model, layout, quantity,
                          dtype, tiles=True, memfd=True, **others)
        ask.credit_bytes = ask.credit_bytes or AHEAD_BYTES
        with self._connection.request(wire.FETCH, ask) as request:
            yield from shared_pictures(ask, request)

    def relight(self, take: str, weights: Weights, *, mode: Any = "shared",
                region: Optional[Sequence[int]] = None, camera: int = 0, max_error: float = 0,
                model: Any = "sphere", promotion: Optional[messages.Promotion] = None,
                out: Optional[Array] = None, **others: Any) -> Relit:
        """The take under other light: weights in radiance x sr, gains not applied.

        `mode` "shared": {channel: [n_lights]}; "per_target": {channel: [3][n_lights]}, a set for each
        of red, green and blue; "tristimulus": [3][n_lights] on white. With one axis more in front,
        several pictures are made in one pass. `max_error`: what may be left out, before promotion.
        `out`: an array that the pictures are received into. The result is linear camera RGB."""
        kind = number(messages.WeightMode, mode)
        channels, rows, many = rows_of(weights, kind)
        ask = messages.Relight(
            take=take, mode=kind, channels=channels, n_lights=rows.shape[-1],
            region=region_message(region), camera=camera, max_error=max_error,
            n_pictures=len(rows), **others)
        ask.promotion.CopyFrom(promotion or messages.Promotion(model=number(messages.Model, model)))
        canvas = Canvas(len(rows), out)
        report = messages.RelightReply()
        with self._connection.request(wire.RELIGHT, ask, rows.tobytes(), canvas.room) as request:
            for answer in request:
                report = answer.message
        assert canvas.pixels is not None, "a relit picture has rows"
        return Relit(canvas.pixels if many else canvas.pixels[0], report)
