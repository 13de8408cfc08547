-- Which end of its job a notice tells: 1, or more after a retry.
ALTER TABLE notices ADD COLUMN nth INTEGER NOT NULL DEFAULT 1;

-- Uploads by URL that no job is made of yet.
CREATE TABLE reservations (
    id         TEXT    PRIMARY KEY, -- of the job that it will be
    tenant     TEXT    NOT NULL,
    upload     TEXT    NOT NULL,
    expires_at INTEGER NOT NULL
) STRICT;
CREATE INDEX reservations_by_tenant ON reservations (tenant);
CREATE INDEX reservations_by_end ON reservations (expires_at);
