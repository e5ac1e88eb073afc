"""Decodes every message of the given recordings with nothing of ours, and prints what each topic holds."""

import collections
import struct
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def check(topic, schema, message):
    """Looks into a message as a user of it would."""
    assert message.timestamp.seconds >= 946_684_800, "logical time starts in 2000"
    if schema.name == "foxglove.PointCloud":
        fields = {field.name: field.offset for field in message.fields}
        assert len(message.data) % message.point_stride == 0
        struct.unpack_from("<3f", message.data, fields["x"])
        return sorted(fields)
    if schema.name == "foxglove.RawImage":
        assert message.encoding == "mono8"
        assert len(message.data) == message.height * message.width
        return [message.height, message.width]
    if schema.name == "carl.Trajectory":
        assert len(message.row) == len(message.col) > 0
        return [len(message.row)]
    if schema.name == "foxglove.Log":
        assert message.message
        return [message.message]
    assert schema.name.startswith("carl.scalars."), schema.name
    values = [field.name for field in message.DESCRIPTOR.fields if field.number >= 10]
    assert all(isinstance(getattr(message, name), float) for name in values)
    return values


def main(paths):
    counts, shapes = collections.Counter(), {}
    for path in paths:
        with open(path, "rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            metadata = {record.name: record.metadata for record in reader.iter_metadata()}
            assert metadata["carl.node"]["node"], path
            last = collections.defaultdict(lambda: -1)
            for schema, channel, raw, message in reader.iter_decoded_messages():
                assert raw.log_time == raw.publish_time
                assert raw.sequence == last[channel.id] + 1
                last[channel.id] = raw.sequence
                shapes[channel.topic] = (schema.name, check(channel.topic, schema, message))
                counts[channel.topic] += 1
            assert sum(counts.values()) > 0
    for topic in sorted(counts):
        print(counts[topic], topic, *shapes[topic])


main(sys.argv[1:])
