-- The tables, in SQLite's dialect; `postgres/opening.rs` has what PostgreSQL calls the same. Times are microseconds since
-- 1970-01-01 UTC by the clock of the store. Columns named here as JSON hold it as text.
CREATE TABLE jobs (
    number           INTEGER PRIMARY KEY AUTOINCREMENT, -- counts the jobs ever created: the order of queue and list
    id               TEXT    NOT NULL UNIQUE,
    tenant           TEXT    NOT NULL,
    state            TEXT    NOT NULL,
    spec             TEXT    NOT NULL,                  -- JSON
    webhook          TEXT,                              -- of the spec
    is_small         INTEGER NOT NULL,                  -- of the spec
    progress         TEXT    NOT NULL,                  -- JSON
    problem          TEXT,                              -- JSON
    summary          TEXT,                              -- JSON
    cancel_requested INTEGER NOT NULL DEFAULT 0,
    attempt          INTEGER NOT NULL DEFAULT 0,        -- claims so far: the fence
    uncounted        INTEGER NOT NULL DEFAULT 0,        -- of them, those that do not count
    begun            INTEGER NOT NULL DEFAULT 0,        -- whether the reading of the current attempt began
    suspicion        INTEGER NOT NULL DEFAULT 0,        -- crashes of workers while the job had begun
    not_before       INTEGER,                           -- of a waiting suspect: when it may start
    worker           TEXT,                              -- name of the worker that claimed the job last
    worker_id        TEXT,                              -- its row in workers
    lease_until      INTEGER,                           -- of a running job
    urgency          INTEGER NOT NULL,                  -- the priority, negated: ascending is first
    last_seq         INTEGER NOT NULL,                  -- number of the last event
    ends             INTEGER NOT NULL DEFAULT 0,        -- ends so far: several after a retry
    idempotency_key  TEXT,
    request_digest   TEXT,                              -- of the request that came with the key
    created_at       INTEGER NOT NULL,
    started_at       INTEGER,
    ended_at         INTEGER
) STRICT;

CREATE UNIQUE INDEX jobs_by_key ON jobs (tenant, idempotency_key) WHERE idempotency_key IS NOT NULL;
CREATE INDEX jobs_waiting ON jobs (state, tenant, urgency, number) WHERE state = 'queued';
CREATE INDEX jobs_suspect ON jobs (state, tenant, not_before, number) WHERE state = 'queued' AND suspicion > 0;
CREATE INDEX jobs_running ON jobs (state, tenant, worker_id) WHERE state = 'running';
CREATE INDEX jobs_by_end ON jobs (ended_at) WHERE ended_at IS NOT NULL;
CREATE INDEX jobs_by_tenant ON jobs (tenant, created_at, id);
-- without jobs that have not ended: a claim must not read those that have
CREATE INDEX jobs_ended ON jobs (tenant, state, created_at, id) WHERE ended_at IS NOT NULL;

CREATE TABLE events (
    job  INTEGER NOT NULL,
    seq  INTEGER NOT NULL,
    kind TEXT    NOT NULL,
    data TEXT    NOT NULL,
    PRIMARY KEY (job, seq)
) STRICT, WITHOUT ROWID;

-- Small files of jobs: of the upload until the job ends, of the result from then on.
CREATE TABLE blobs (
    job   INTEGER NOT NULL,
    name  TEXT    NOT NULL,
    bytes BLOB    NOT NULL,
    PRIMARY KEY (job, name)
) STRICT;

-- Ends that a webhook is to tell; they outlast their jobs.
CREATE TABLE notices (
    place        INTEGER PRIMARY KEY AUTOINCREMENT, -- the order of the ends
    job          TEXT    NOT NULL UNIQUE,
    webhook      TEXT    NOT NULL,
    trace_parent TEXT,
    state        TEXT    NOT NULL,
    problem      TEXT,                              -- JSON
    ended_at     INTEGER NOT NULL,
    nth          INTEGER NOT NULL                   -- which end of its job: more than 1 after a retry
) STRICT;

-- Services that work on jobs. One whose alive_until is over was lost, with all its jobs.
CREATE TABLE workers (
    id          TEXT    PRIMARY KEY,
    name        TEXT    NOT NULL,
    version     TEXT    NOT NULL,
    device      TEXT,
    started_at  INTEGER NOT NULL,
    seen_at     INTEGER NOT NULL,
    lease       INTEGER NOT NULL DEFAULT 0,         -- length of its leases
    alive_until INTEGER NOT NULL DEFAULT 0
) STRICT;

-- Virtual times of tenants: see the fairness of claims.
CREATE TABLE tenants (
    name   TEXT PRIMARY KEY,
    served REAL NOT NULL, -- start of its last turn
    next   REAL NOT NULL  -- start of its next turn
) STRICT;

-- One row, about the store itself.
CREATE TABLE identity (
    id           INTEGER PRIMARY KEY,
    name         TEXT NOT NULL, -- by which its files are known; empty until they are
    cleaner      TEXT,          -- the service that cleans up and delivers webhooks for all
    cleans_until INTEGER,       -- until when
    probed_at    INTEGER        -- written to see whether anything can be
) STRICT;
INSERT INTO identity (id, name) VALUES (1, '');
