"""Mechanisms and motions as frozen data: links, joints, drives, attachments, time laws; nothing here is compiled."""
