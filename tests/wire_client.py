"""A client made of the tables of protocol/WIRE.md and of nothing else.

    wire_client.py WIRE.md            decodes and encodes the page's golden bytes
    wire_client.py WIRE.md SOCKET     and talks to a board on a unix socket: greeting, refusals, a jog,
                                      a stream that moves 5 mm, frames after its end, a second line

Prints one line for each thing that it found right; ends with status 1 at the first that is not.
"""

import re
import socket
import struct
import sys
import time
import zlib


class Page:
    """Tables of the page: name -> rows of (number, name, [(field, type)])."""

    def __init__(self, text):
        self.text = text
        self.types = {}
        for name, body in re.findall(r"<!-- table (\w+) -->\n\n(.*?)\n\n", text + "\n\n", re.S):
            rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in body.splitlines()[2:]]
            if name in ("ranges", "knots"):
                self.types[name] = rows
                continue
            parsed = []
            for number, row_name, fields in rows:
                fields = [tuple(field.strip().split(" ", 1)) for field in fields.split(",") if field.strip()]
                parsed.append((int(number) if number else None, row_name, fields))
            self.types[name] = parsed
        self.structs = {name: fields for _, name, fields in self.types["structs"]}
        schema = re.search(r"<!-- schema -->\n((?:    .*\n)+)", text).group(1)
        self.schema = zlib.crc32("".join(line[4:] + "\n" for line in schema.splitlines()).encode())
        self.version = int(re.search(r"Protocol version (\d+)\.", text).group(1))
        golden = text.split("<!-- golden -->")[1].split("\n\n")[1]
        self.golden = [line.split() for line in golden.splitlines()]

    def read(self, data, kind):
        """One value of a type -> (value, rest)."""
        if match := re.fullmatch(r"(\w+)\*(\d+)", kind):
            values = []
            for _ in range(int(match.group(2))):
                value, data = self.read(data, match.group(1))
                values.append(value)
            return values, data
        if kind in ("u8", "bool"):
            return data[0], data[1:]
        if kind in ("u16", "u32"):
            value = shift = 0
            while True:
                byte, data = data[0], data[1:]
                value |= (byte & 127) << shift
                shift += 7
                if byte < 128:
                    return value, data
        if kind == "f32":
            return struct.unpack("<f", data[:4])[0], data[4:]
        if kind in ("i16", "i32"):
            value, data = self.read(data, "u32")
            return (value >> 1) ^ -(value & 1), data
        if kind == "bytes":
            length, data = self.read(data, "u32")
            return data[:length], data[length:]
        if kind.startswith("vec "):
            length, data = self.read(data, "u32")
            values = []
            for _ in range(length):
                value, data = self.read(data, kind[4:])
                values.append(value)
            return values, data
        if kind.startswith("option "):
            return self.read(data[1:], kind[7:]) if data[0] else (None, data[1:])
        if kind in self.structs:
            return self.read_fields(data, kind, self.structs[kind])
        number, data = self.read(data, "u32")
        name, fields = next((name, fields) for n, name, fields in self.types[kind] if n == number)
        return self.read_fields(data, name, fields)

    def read_fields(self, data, name, fields):
        message = {"": name}
        for field, kind in fields:
            message[field], data = self.read(data, kind)
        return message, data

    def write(self, value, kind):
        if match := re.fullmatch(r"(\w+)\*(\d+)", kind):
            return b"".join(self.write(item, match.group(1)) for item in value)
        if kind in ("u8", "bool"):
            return bytes([value])
        if kind in ("u16", "u32"):
            out = bytearray()
            while value > 127:
                out.append(value & 127 | 128)
                value >>= 7
            return bytes(out + bytes([value]))
        if kind == "f32":
            return struct.pack("<f", value)
        if kind in ("i16", "i32"):
            return self.write(value << 1 if value >= 0 else (-value << 1) - 1, "u32")
        if kind == "bytes":
            return self.write(len(value), "u32") + value
        if kind.startswith("vec "):
            return self.write(len(value), "u32") + b"".join(self.write(item, kind[4:]) for item in value)
        if kind.startswith("option "):
            return b"\0" if value is None else b"\1" + self.write(value, kind[7:])
        if kind in self.structs:
            return b"".join(self.write(value[field], k) for field, k in self.structs[kind])
        number, fields = next((n, fields) for n, name, fields in self.types[kind] if name == value[""])
        return self.write(number, "u32") + b"".join(self.write(value[field], k) for field, k in fields)


def unstuff(data):
    out, place = bytearray(), 0
    while place < len(data):
        code = data[place]
        out += data[place + 1 : place + code]
        place += code
        if code < 255 and place < len(data):
            out.append(0)
    return bytes(out)


def stuff(data):
    out, block = bytearray(), bytearray()
    for byte in data:
        if byte:
            block.append(byte)
        if not byte or len(block) == 254:
            out += bytes([len(block) + 1]) + block
            block = bytearray()
    return bytes(out + bytes([len(block) + 1]) + block)


def frame(sequence, payload):
    body = struct.pack("<H", sequence & 0xFFFF) + payload
    return stuff(body + struct.pack("<I", zlib.crc32(body)))


def unframe(data):
    body = unstuff(data)
    check(struct.unpack("<I", body[-4:])[0] == zlib.crc32(body[:-4]), "a frame's CRC")
    return struct.unpack("<H", body[:2])[0], body[2:-4]


def wrap(value):
    return (value + 2**31) % 2**32 - 2**31


def bits_of(data):
    for byte in data:
        for place in range(7, -1, -1):
            yield byte >> place & 1


def take(bits, count):
    value = 0
    for _ in range(count):
        value = value << 1 | next(bits)
    return value


def decode_block(data, start):
    """Knots of a block that begins at `start`, by the page's "Knot block"."""
    bits = bits_of(data)
    count, shortest, width = take(bits, 5) + 1, take(bits, 12) + 1, take(bits, 4)
    channels = []
    for _ in range(7):
        order = take(bits, 2)
        channels.append((order, take(bits, 5) if order < 3 else 0))
    points = [list(start)] * 3
    # h of spans -2, -1, 0, 1: span n is at place n + 2.
    spans, knots = [8, 8, 8, 8], []
    for n in range(count):
        duration = shortest + take(bits, width)
        spans.append(duration)
        h = lambda i: spans[i + 2]
        most = 16 << 20
        d1 = h(n) + h(n + 1) + h(n + 2)
        d2 = h(n - 1) + h(n) + h(n + 1)
        d3 = h(n - 2) + h(n - 1) + h(n)
        line = min((d1 << 20) // d2, most)
        bend = min((d1 * (d1 + d2) << 20) // (d2 * (d2 + d3)), most)
        far = min((d1 * (d1 + d2) << 20) // (d3 * (d2 + d3)), most)
        p1, p2, p3 = points[-1], points[-2], points[-3]
        control = []
        for channel, (order, k) in enumerate(channels):
            one, two = wrap(p1[channel] - p2[channel]), wrap(p2[channel] - p3[channel])
            step = 0
            if order == 1:
                step = one * line + (1 << 19) >> 20
            elif order == 2:
                step = one * (line + bend) - two * far + (1 << 19) >> 20
            residual = 0
            if order < 3:
                ones = 0
                while ones < 20 and next(bits):
                    ones += 1
                z = take(bits, 32) if ones == 20 else ones << k | take(bits, k)
                residual = (z >> 1) ^ -(z & 1)
            control.append(wrap(p1[channel] + step + residual))
        points.append(control)
        knots.append((control, duration))
    return knots


def encode_block(knots, last):
    """A plain block: every channel predicted by the control point before it."""
    shortest = min(duration for _, duration in knots)
    width = max(duration - shortest for _, duration in knots).bit_length()
    bits = [(len(knots) - 1, 5), (shortest - 1, 12), (width, 4)]
    k = 12
    bits += [(0, 2), (k, 5)] * 7
    for control, duration in knots:
        bits.append((duration - shortest, width))
        for now, before in zip(control, last):
            residual = now - before
            z = residual << 1 if residual >= 0 else (-residual << 1) - 1
            check(z >> k < 20, "small residuals")
            bits += [(1, 1)] * (z >> k) + [(0, 1), (z & (1 << k) - 1, k)]
        last = control
    text = "".join(format(value, f"0{count}b") for value, count in bits if count)
    text += "0" * (-len(text) % 8)
    return bytes(int(text[i : i + 8], 2) for i in range(0, len(text), 8))


def check(condition, what):
    if not condition:
        sys.exit(f"wrong: {what}")


def check_golden(page):
    kinds = {row[0]: ("DeviceMessage" if int(row[1], 16) >= 0x100 else "HostMessage") for row in page.golden}
    for name, sequence, bytes_hex in page.golden:
        number, payload = unframe(bytes.fromhex(bytes_hex))
        check(number == int(sequence, 16), f"{name}: its sequence number")
        message, rest = page.read(payload, kinds[name])
        check(rest == b"", f"{name}: {rest.hex()} left over")
        check(page.write(message, kinds[name]) == payload, f"{name}: encodes to itself")
        check(frame(number, payload).hex() == bytes_hex, f"{name}: its frame")
        if name == "hello":
            check(message["schema"] == page.schema, "the schema's CRC")
            check(message["protocol"] == page.version, "the version")
        if name == "knots":
            knots = decode_block(message["block"], [1000000, -2000000, 2000, 0, 0, 1570796, 0])
            for number, control, duration in page.types["knots"]:
                expected = ([int(value) for value in control.split()], int(duration))
                check(knots[int(number)] == expected, f"knot {number}: {knots[int(number)]}")
    print(f"{len(page.golden)} golden frames decode and encode")


class Line:
    """A conversation over a socket."""

    def __init__(self, page, path, session):
        self.page, self.buffer, self.control, self.session = page, b"", 0, session
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(path)
        self.socket.settimeout(0.05)

    def send(self, message, sequence=None):
        if sequence is None:
            self.control += 1
            sequence = self.control
        self.socket.sendall(frame(sequence, self.page.write(message, "HostMessage")) + b"\0")
        return sequence

    def command(self, name, **fields):
        return self.send({"": "Control", "command": {"": name, **fields}})

    def hello(self):
        self.send({"": "Hello", "protocol": self.page.version, "schema": self.page.schema,
                   "host_session": self.session})
        return self.until("a welcome", lambda m: m[""] == "Welcome")

    def until(self, what, wanted):
        end = time.time() + 20
        while time.time() < end:
            try:
                self.buffer += self.socket.recv(4096)
            except TimeoutError:
                pass
            while b"\0" in self.buffer:
                data, self.buffer = self.buffer.split(b"\0", 1)
                if not data:
                    continue
                message, rest = self.page.read(unframe(data)[1], "DeviceMessage")
                check(rest == b"", "nothing behind a message")
                check(message[""] != "Fault" or what == "a fault", f"no fault: {message}")
                if wanted(message):
                    return message
        sys.exit(f"wrong: {what} did not come")

    def refused(self, sequence, reason):
        message = self.until(f"{reason}", lambda m: m[""] == "Refused")
        check((message["sequence"], message["reason"][""]) == (sequence, reason), f"{message} for {reason}")

    def status(self, what, wanted):
        self.command("StatusRequest")
        return self.until(what, lambda m: m[""] == "Status" and wanted(m))


def talk(page, path):
    line = Line(page, path, 1)
    line.refused(line.command("Pause"), "NoHello")
    welcome = line.hello()
    for field, lowest, highest in page.types["ranges"]:
        name, field = field.split(".")
        fields = next(f for kind in ("Control", "HostMessage") for _, n, f in page.types[kind] if n == name)
        one = lambda kind: {"": "Prime"} if kind == "FlowAction" else [1] * int(kind[4:]) if "*" in kind else 1
        empty = {f: one(k) for f, k in fields}
        most = {"u8": 255, "u16": 65535, "u32": 2**32 - 1}[dict(fields)[field]]
        for value in [int(lowest) - 1] * (int(lowest) > 0) + [int(highest) + 1] * (int(highest) < most):
            body = {"": name, **empty, field: value}
            if name == "Flow":
                # No stream is open.
                line.refused(line.send(body, 9), "NoStream")
            elif name == "Start":
                line.refused(line.send(body), "Invalid")
            else:
                line.refused(line.send({"": "Control", "command": body}), "Invalid")
    print("every field out of its range is refused")
    before = line.status("idle", lambda m: m["state"][""] == "Idle")["counts"][0]
    line.command("Jog", joint=0, distance=10000, speed=100000)
    line.status("jogging", lambda m: m["state"][""] == "Jogging")
    idle = line.until("rest", lambda m: m[""] == "Status" and m["state"][""] == "Idle")
    per_mm = idle["counts"][0] - before
    print(f"a jog of 1 mm is {per_mm} steps")
    start = [1000000, 1000000, 20000, 0, 0, 0, 0]
    first = 4242
    line.send({"": "Start", "job": 7, "machine_hash": welcome["machine_hash"], "first_sequence": first,
               "position": start, "solution": 0, "length": 0, "angle": 0, "volume": 0})
    line.until("credits", lambda m: m[""] == "Ack" and m["next_sequence"] == first and m["knot_limit"] > 100)
    # 5 mm in x over two seconds, eased; then rest.
    ease = lambda x: x**3 * (10 - 15 * x + 6 * x * x)
    places = [start] * 4 + [[start[0] + round(50000 * ease(i / 80)), *start[1:]] for i in range(81)]
    knots = [(place, 50) for place in places + [places[-1]] * 4]
    began = line.status("filling", lambda m: m["state"][""] == "Filling")["counts"][0]
    last, sequence = start, first
    for at in range(0, len(knots), 12):
        part = knots[at : at + 12]
        line.send({"": "Knots", "block": encode_block(part, last)}, sequence)
        last, sequence = part[-1][0], sequence + 1
    line.send({"": "Finish", "knots": len(knots), "events": 0}, sequence)
    line.until("its end taken", lambda m: m[""] == "Ack" and m["next_sequence"] == sequence + 1)
    line.refused(line.send({"": "Finish", "knots": 0, "events": 0}, sequence + 1), "NoStream")
    second = Line(page, path, 2)
    check(second.hello()["stream"]["job"] == 7, "a second line hears of the stream")
    second.refused(second.command("Jog", joint=0, distance=10000, speed=100000), "Busy")
    done = line.until("the end", lambda m: m[""] == "Status" and m["state"][""] == "Finished")
    check(done["spans_done"] == len(knots), f"all spans: {done}")
    made = done["counts"][0] - began
    check(abs(made - 5 * per_mm) <= 1, f"5 mm: {made} steps")
    print(f"a stream of {len(knots)} knots moved 5 mm in {made} steps")
    second.command("EmergencyStop")
    fault = line.until("a fault", lambda m: m[""] == "Fault")["fault"]
    check(fault["cause"][""] == "Emergency", "a stop from the second line")
    print("a second line stops")


def main():
    page = Page(open(sys.argv[1], encoding="utf-8").read())
    check_golden(page)
    if len(sys.argv) > 2:
        talk(page, sys.argv[2])


main()
