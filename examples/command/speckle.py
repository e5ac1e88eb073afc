"""Turns a share of the pixels of transitions over: black becomes white, and white black."""

import argparse
import json
import os
import random
import struct

arguments = argparse.ArgumentParser()
arguments.add_argument("--from", dest="source")
arguments.add_argument("--to")
arguments.add_argument("--share", type=float)
arguments.add_argument("--seed", type=int)
arguments = arguments.parse_args()

# Lines of JSON on this descriptor become metrics, curves and progress.
events = os.fdopen(int(os.environ["CARL_EVENTS"]), "w", buffering=1)

# A safetensors file: the length of a JSON header, the header, the numbers.
with open(arguments.source, "rb") as file:
    (length,) = struct.unpack("<Q", file.read(8))
    header = json.loads(file.read(length))
    numbers = bytearray(file.read())

draw = random.Random(arguments.seed)
turned = 0
names = ["observations", "next_observations"]
for number, name in enumerate(names):
    begin, end = header[name]["data_offsets"]
    for at in range(begin, end):
        if draw.random() < arguments.share:
            numbers[at] ^= 255
            turned += 1
    print(json.dumps({"progress": number + 1, "of": len(names)}), file=events)

with open(arguments.to, "wb") as file:
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    file.write(struct.pack("<Q", len(text)) + text + numbers)
print(json.dumps({"metric": "turned_pixels", "value": turned}), file=events)
print(f"turned {turned} pixels over")
