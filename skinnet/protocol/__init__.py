"""Wire protocol: channel table and keys, messages, record layouts."""
