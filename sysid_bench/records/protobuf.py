"""Field names -> protobuf message classes, made at run time: no generated code and no protoc."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import Message

_Field = descriptor_pb2.FieldDescriptorProto
_TYPES = {
    "double": _Field.TYPE_DOUBLE,
    "uint32": _Field.TYPE_UINT32,
    "uint64": _Field.TYPE_UINT64,
    "int64": _Field.TYPE_INT64,
    "bool": _Field.TYPE_BOOL,
    "string": _Field.TYPE_STRING,
    "bytes": _Field.TYPE_BYTES,
}


def message_class(full_name: str, fields: Mapping[str, str]) -> type[Message]:
    """Class of the message `full_name` ("package.Name") with the given fields, numbered in their order.

    `fields` maps a field's name to its type: double, uint32, uint64, int64, bool, string, bytes, or
    "repeated double" (packed) and the like.
    """
    return _message_class(full_name, tuple(fields.items()))


@lru_cache(maxsize=64)
def _message_class(full_name: str, fields: tuple[tuple[str, str], ...]) -> type[Message]:
    package, _, name = full_name.rpartition(".")
    file = descriptor_pb2.FileDescriptorProto(name=f"{full_name}.proto", package=package, syntax="proto3")
    message = file.message_type.add(name=name)
    for number, (field, kind) in enumerate(fields, start=1):
        repeated, _, scalar = kind.rpartition(" ")
        label = _Field.LABEL_REPEATED if repeated else _Field.LABEL_OPTIONAL
        message.field.add(name=field, number=number, type=_TYPES[scalar], label=label)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(full_name))


def schema_data(message: type[Message]) -> bytes:
    """Serialized FileDescriptorSet of a message class: the `data` of an MCAP schema with encoding protobuf."""
    files = descriptor_pb2.FileDescriptorSet()
    message.DESCRIPTOR.file.CopyToProto(files.file.add())
    return files.SerializeToString()


def class_from_schema(full_name: str, data: bytes) -> type[Message]:
    """Class of the message `full_name` described by a FileDescriptorSet; inverse of `schema_data`.

    Raises google.protobuf's DecodeError, TypeError or KeyError where the description is damaged.
    """
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(data).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(full_name))
