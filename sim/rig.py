"""A simulated stage in a folder: simulator, daemon and client, started, driven and ended.

Used by sim/demo.py and by the integration tests. Processes die with their parent and are ended by
pid; addresses are loopback addresses of this process's own.
"""
import ctypes
import json
import os
import signal
import subprocess

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
STOP_SECONDS = 30
CALL_SECONDS = 3600
SENSOR_MM = 11.26
MAX_FPS = 72
VIEWS = (("front", [0.0, 0.0, 1.6]), ("left", [-1.0, 0.2, 1.2]),  # name, position in m
         ("right", [1.0, 0.2, 1.2]), ("above", [0.0, 1.0, 1.25]))
READOUT_PX_PER_S = 36e6  # what the simulated sensor makes and two cores can take in, with room


class Failed(Exception):
    """A program said no; its sentence is the text, its exit code is .code."""

    def __init__(self, text, code=1):
        super().__init__(text)
        self.code = code


def call(*command, quiet=True, timeout=CALL_SECONDS):
    """Run to the end and return what it printed; Failed with its last words otherwise."""
    done = subprocess.run(command, stdout=subprocess.PIPE if quiet else None,
                          stderr=subprocess.PIPE if quiet else None, text=True, timeout=timeout,
                          stdin=subprocess.DEVNULL)
    if done.returncode:
        words = ((done.stderr or "").strip() or "\n".join((done.stdout or "").splitlines()[-10:])
                 or f"exited with {done.returncode}")
        raise Failed(f"{os.path.basename(command[0])}: {words}", done.returncode)
    return done.stdout


def write(path, text):
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


def say(text):
    print(f"== {text}", flush=True)


def read(path):
    with open(path, encoding="utf-8", errors="replace") as file:
        return file.read()


def loopback(number=1):
    """A loopback address of this process's own, so that runs side by side do not collide."""
    pid = os.getpid()
    return f"127.{64 + pid // 250 % 128}.{1 + pid % 250}.{number}"


def die_with_parent():
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


class Process:
    """A child that writes one line of JSON when it is ready; its output goes to a log."""

    def __init__(self, log, *command, environment={}):
        ready, pipe = os.pipe()
        self.name, self.log = os.path.basename(command[0]), log
        with open(log, "a", encoding="utf-8") as out:
            self.child = subprocess.Popen([*command, "--ready-fd", str(pipe)], stdout=out,
                                          stderr=out, stdin=subprocess.DEVNULL, pass_fds=[pipe],
                                          env={**os.environ, **environment},
                                          preexec_fn=die_with_parent)
        os.close(pipe)
        with os.fdopen(ready, encoding="utf-8") as lines:
            line = lines.readline()
        if not line:
            self.child.wait(STOP_SECONDS)
            raise Failed(f"{self.name} did not start: {read(log).strip()}", self.child.returncode)
        self.ready = json.loads(line)

    def kill(self):
        self.child.kill()
        self.child.wait()

    def stop(self):
        """End it; None, or a sentence about how that went wrong."""
        if self.child.poll() is None:
            self.child.terminate()
        try:
            code = self.child.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self.kill()
            return f"{self.name} did not end within {STOP_SECONDS} s of SIGTERM"
        return f"{self.name} ended with {code}: {read(self.log)[-500:]}" if code else None


class Rig:
    """One simulated stage. The *_extra texts are appended to the configuration they name; size is
    in pixels, one number or (width, height); region is the middle part of it that the daemon's
    camera reads out, the whole by default; positions is (file, axes, unit) as the daemon reads
    them, the simulator's own by default; cameras is how many of VIEWS there are, all alike but for
    where they stand; wire is the controller's, as the daemon calls its driver; environment is the
    daemon's, beside this process's own.
    """

    def __init__(self, build, folder, size=512, scene="stilllife", channels="WRAGCBVH",
                 scene_extra="", camera_extra="", simulator_extra="", daemon_extra="",
                 rig_camera_extra="", controller_extra="", cfa="RG", pixel_format="BayerRG12", calibrated=True,
                 packet_size=9000, timeout_ms=2000, focal_mm=25,
                 blur_px=0, wire="modbus",
                 positions=("positions.csv", "right,up,towards", "m"), region=None,
                 calibration="calibration.json", cameras=1, environment={}, rig_extra=""):
        self.build, self.folder = build, folder
        self.width, self.height = (size, size) if isinstance(size, int) else size
        self.channels, self.pixel_format = channels, pixel_format
        self.focal_mm, self.blur_px, self.positions = focal_mm, blur_px, positions
        self.daemon_extra, self.rig_camera_extra = daemon_extra, rig_camera_extra
        self.rig_extra = rig_extra
        self.calibration, self.wire, self.environment = calibration, wire, environment
        self.calibrated, self.packet_size, self.timeout_ms = calibrated, packet_size, timeout_ms
        self.region = region or (self.width, self.height)
        self.max_fps = min(MAX_FPS, READOUT_PX_PER_S / (self.region[0] * self.region[1]))
        self.addresses = [loopback(k + 1) for k in range(cameras)]
        self.dome = self.daemon = None
        self.preload = []  # libraries of the daemon alone
        self.scene = (scene, scene_extra, cfa, camera_extra, simulator_extra)
        self.controller_extra = controller_extra
        self.write_simulator("" if wire == "modbus" else f'wire = "{wire}";')
        self.simulator("describe", "--pixel-format", pixel_format, "--output", folder)

    def cameras(self):
        """(name, address, position) of each."""
        return [(name, address, position) for (name, position), address in
                zip(VIEWS, self.addresses)]

    def write_simulator(self, controller):
        scene, scene_extra, cfa, camera_extra, simulator_extra = self.scene
        cameras = ",\n".join(f"""
    {{ address = "{address}"; position_m = {position}; width = {self.width};
      height = {self.height}; cfa = "{cfa}"; focal_length_mm = {float(self.focal_mm)};
      blur_px = {float(self.blur_px)}; {camera_extra} }}"""
                             for _, address, position in self.cameras())
        write(self.path("sim.conf"), f"""
scene = {{ scene = "{scene}"; {scene_extra} }};
cameras = ({cameras} );
log = "shown.jsonl";
controller = {{ {controller} {self.controller_extra} }};
{simulator_extra}
""")

    def place(self, scene):
        """Another object on the stage: the same dome and cameras at the same addresses."""
        port = self.dome.ready["modbus_port"]
        wrong = self.dome.stop()
        self.dome = None
        if wrong:
            raise Failed(wrong)
        self.scene = (scene, *self.scene[1:])
        self.write_simulator(f"port = {port};")
        self.start_simulator()

    def path(self, name):
        return os.path.join(self.folder, name)

    def program(self, path):
        return os.path.join(self.build, path)

    def simulator(self, command, *arguments):
        return call(self.program("sim/lightstage-sim"), command, "--config", self.path("sim.conf"),
                    *arguments)

    def usb(self):
        """What libusb and libudev see through this library is what the simulator plugs in."""
        return {"LD_PRELOAD": "libumockdev-preload.so.0"} if self.wire == "usb" else {}

    def start_simulator(self):
        self.dome = Process(self.path("sim.log"), self.program("sim/lightstage-sim"), "run",
                            "--config", self.path("sim.conf"), environment=self.usb())

    def start_daemon(self):
        self.write_configuration()
        testbed = {"UMOCKDEV_DIR": self.dome.ready["controller_path"]} if self.usb() else {}
        preload = ":".join([*self.usb().values(), *self.preload])
        if preload:
            testbed["LD_PRELOAD"] = preload
        program = os.environ.get("LS_DAEMON") or self.program("daemon/lightstaged")
        self.daemon = Process(self.path("daemon.log"), program, "--config", self.path("daemon.conf"),
                              environment={**testbed, **self.environment})

    def start(self):
        self.start_simulator()
        self.start_daemon()
        return self

    def stop(self):
        """End both; a list of sentences about what went wrong."""
        ended = [p.stop() for p in (self.daemon, self.dome) if p]
        self.daemon = self.dome = None
        return [sentence for sentence in ended if sentence]

    def controller_address(self):
        if self.wire == "modbus":
            return f'address = "127.0.0.1"; port = {self.dome.ready["modbus_port"]};'
        return f'address = "{"any" if self.wire == "usb" else self.dome.ready["controller_path"]}";'

    def write_configuration(self):
        constants = json.loads(read(self.path("calibration.json")))["camera"]
        calibration = f'calibration = "{self.calibration}";' if self.calibrated else ""
        write(self.path("daemon.conf"), f"""
storage = "takes";
socket = "socket";
rig = "rig.conf";
{calibration}
controller = {{ driver = "{self.wire}"; {self.controller_address()}
               timeout_ms = {self.timeout_ms}; }};
{self.daemon_extra}
""")
        file, axes, unit = self.positions
        width, height = self.region
        offset_x, offset_y = (self.width - width) // 2, (self.height - height) // 2
        sensor = SENSOR_MM / self.width  # mm of a pixel
        channels = ", ".join('{ name = "%s"; kind = "%s"; }' %
                             (c, "polariser" if c in "VH" else "spectrum") for c in self.channels)
        cameras = ",\n".join(f"""
  {{ name = "{name}"; address = "{address}";
    width = {width}; height = {height}; offset_x = {offset_x}; offset_y = {offset_y};
    pixel_format = "{self.pixel_format}"; packet_size = {self.packet_size};
    max_fps = {self.max_fps:.2f};
    position_m = {position}; look_at_m = [0.0, 0.0, 0.0]; focal_length_mm = {self.focal_mm};
    sensor_mm = [{sensor * width}, {sensor * height}]; range = [0.10, 0.85];
    black_dn = {constants['black_dn']}; full_scale_dn = {constants['full_scale_dn']};
    electrons_per_dn = {constants['electrons_per_dn']};
    read_noise_dn = {constants['read_noise_dn']};
    exposure_offset_us = {constants['exposure_offset_us']};
    lens = "simulated"; aperture = 8; iso_speed = 100;
    {self.rig_camera_extra} }}""" for name, address, position in self.cameras())
        write(self.path("rig.conf"), f"""
name = "simulated dome";
lights = {{ positions = "{file}"; axes = "{axes}"; unit = "{unit}"; }};
channels = ( {channels} );
cameras = ({cameras} );
{self.rig_extra}
""")

    def control(self, *arguments, quiet=True, timeout=CALL_SECONDS):
        return call(self.program("clients/lightstagectl"), "--socket", self.path("socket"),
                    *arguments, quiet=quiet, timeout=timeout)

    def ask(self, *arguments):
        """A reading command's answer as an object."""
        return json.loads(self.control(*arguments, "--json"))

    def start_take(self, name, plan, *options, quiet=True):
        """Start a take; returns its id. Waits for its end unless told --no-wait."""
        write(self.path("plan.conf"), plan)
        self.control("take", "start", "--name", name, "--plan", self.path("plan.conf"), *options,
                     quiet=quiet)
        return self.takes()[-1]["id"]

    def takes(self):
        return self.ask("take", "list")["takes"]

    def judge(self, take, *options):
        return json.loads(call(
            self.program("tests/lightstage-judge"), "--simulator", self.path("sim.conf"),
            "--take", self.path(os.path.join("takes", take)), "--log", self.path("shown.jsonl"),
            *options))
