-- Workers: what they say about themselves.
ALTER TABLE workers ADD COLUMN device text;

-- Claims jobs for the worker `me` as claim_1 does, all of them by one statement.
--
-- Claimed one after the other, a tenant's n-th job has the place (running + n) / weight, then start + n / weight. Both
-- rise with n and depend on no other tenant, so sorting all jobs by their places gives the same order as choosing one
-- after the other; only the virtual times of tenants that are equal otherwise may differ by those of one call.
--
-- Plans are generic, as planning would take longer than the claim, and by index, as the statistics of a queue are those
-- of a moment that is over. A claim takes the same time however many jobs wait: a bitmap has no order, so its plan would
-- read all of them.
CREATE FUNCTION claim_2(
    me uuid, me_name text, me_version text, ttl double precision, most integer, newcomers integer,
    alone double precision, alone_from integer,
    share_names text[], share_weights bigint[], share_limits bigint[]
) RETURNS SETOF jobs LANGUAGE plpgsql SET plan_cache_mode = force_generic_plan
    SET enable_seqscan = off SET enable_bitmapscan = off SET jit = off
AS $$
DECLARE
    t       timestamptz;
    until   timestamptz;
    suspect record;
    suspect_number bigint;   -- a suspect that starts now
    others  integer := most; -- jobs beside it
BEGIN
    IF NOT EXISTS (SELECT FROM jobs WHERE state = 'queued') THEN
        RETURN;
    END IF;
    PERFORM set_config('synchronous_commit', 'off', true);
    PERFORM pg_advisory_xact_lock(1953723250, 1);
    t := clock_timestamp();
    until := t + make_interval(secs => ttl);
    IF EXISTS (
        SELECT FROM jobs WHERE boot = me AND state = 'running' AND suspicion >= alone_from
        AND started_at + make_interval(secs => alone) > t
    ) THEN
        RETURN;
    END IF;
    IF NOT EXISTS (SELECT FROM jobs WHERE boot = me AND state = 'running' AND suspicion > 0) THEN
        SELECT number, suspicion, not_before INTO suspect FROM jobs
        WHERE state = 'queued' AND suspicion > 0 AND not_before <= t
        AND (reserved_by IS NULL OR reserved_by = me OR reserved_until <= t)
        ORDER BY not_before LIMIT 1;
        IF FOUND THEN
            IF suspect.suspicion >= alone_from THEN
                IF suspect.not_before + make_interval(secs => alone) > t
                   AND EXISTS (SELECT FROM jobs WHERE boot = me AND state = 'running') THEN
                    UPDATE jobs SET reserved_by = me, reserved_until = t + make_interval(secs => alone)
                    WHERE number = suspect.number;
                    RETURN;
                END IF;
                IF most = 0 THEN
                    RETURN;
                END IF;
                others := 1;
                newcomers := 0;
            END IF;
            IF most > 0 THEN
                suspect_number := suspect.number;
                others := others - 1;
            END IF;
        END IF;
    END IF;
    -- twice: all that were chosen may have been cancelled in this moment
    FOR attempt IN 1 .. 2 LOOP
        RETURN QUERY
        WITH RECURSIVE heads AS ( -- each step goes to the first waiting job of the next tenant
            (SELECT tenant, urgency, number FROM jobs WHERE state = 'queued' AND suspicion = 0
             ORDER BY tenant, urgency, number LIMIT 1)
            UNION ALL
            SELECT next_one.* FROM heads CROSS JOIN LATERAL (
                SELECT tenant, urgency, number FROM jobs
                WHERE state = 'queued' AND suspicion = 0 AND tenant > heads.tenant
                ORDER BY tenant, urgency, number LIMIT 1
            ) AS next_one
        ), busy AS (
            SELECT tenant, count(*) AS running FROM (
                SELECT tenant FROM jobs WHERE state = 'running'
                UNION ALL SELECT tenant FROM jobs WHERE number = suspect_number
            ) AS started GROUP BY tenant
        ), entitled AS (
            SELECT heads.*, coalesce(busy.running, 0) AS running, shares.limit_running,
                greatest(coalesce(shares.weight, 1), 1)::double precision AS weight,
                greatest(coalesce(tenants.next, 0), (SELECT max(served) FROM tenants)) AS start
            FROM heads
            LEFT JOIN busy USING (tenant)
            LEFT JOIN unnest(share_names, share_weights, share_limits) AS shares(tenant, weight, limit_running)
                USING (tenant)
            LEFT JOIN tenants ON tenants.name = heads.tenant
        ), turns AS ( -- of each tenant as many jobs as may be claimed
            SELECT *, 0 AS nth FROM entitled
            UNION ALL
            SELECT tenant, further.urgency, further.number, running, limit_running, weight, start, further.nth
            FROM entitled CROSS JOIN LATERAL (
                SELECT urgency, number, row_number() OVER (ORDER BY urgency, number) AS nth FROM jobs
                WHERE state = 'queued' AND suspicion = 0 AND jobs.tenant = entitled.tenant
                AND (urgency, number) > (entitled.urgency, entitled.number)
                ORDER BY urgency, number LIMIT greatest(others - 1, 0)
            ) AS further
        ), ranked AS (
            SELECT number, tenant, nth, running, weight, start + nth / weight AS start,
                row_number() OVER (ORDER BY (running + nth) / weight, start + nth / weight, urgency, number) AS place
            FROM turns WHERE limit_running IS NULL OR running + nth < limit_running
        ), chosen AS (
            SELECT suspect_number AS number, NULL AS tenant, NULL AS start, NULL AS next, 0 AS place
            WHERE suspect_number IS NOT NULL
            UNION ALL
            SELECT number, tenant, start, start + 1 / weight, place FROM ranked WHERE place <= others
            UNION ALL
            (SELECT number, tenant, start, start + 1 / weight, place FROM ranked
             WHERE place > others AND nth = 0 AND running = 0 ORDER BY place LIMIT newcomers)
        ), taken AS (
            UPDATE jobs SET state = 'running', attempt = jobs.attempt + 1, started_at = t, lease_until = until,
                worker = me_name, boot = me, begun = coalesce((spec ->> 'is_small')::boolean, false),
                last_seq = last_seq + 1, reserved_by = NULL, reserved_until = NULL
            -- by number: the expression around the state keeps the planner from the index of waiting jobs
            FROM chosen WHERE jobs.number = ANY (ARRAY(SELECT c.number FROM chosen AS c))
            AND jobs.number = chosen.number AND jobs.state || '' = 'queued'
            RETURNING jobs AS job, chosen.*
        ), told AS (
            INSERT INTO events (job, seq, kind, data)
            SELECT (job).number, (job).last_seq, 'started', json_build_array((job).attempt, me_name)::text FROM taken
        ), charged AS (
            INSERT INTO tenants (name, served, next)
            SELECT tenant, max(start), max(next) FROM taken WHERE tenant IS NOT NULL GROUP BY tenant
            ON CONFLICT (name) DO UPDATE SET served = excluded.served, next = excluded.next
        )
        SELECT (job).* FROM taken ORDER BY place;
        IF FOUND THEN
            INSERT INTO workers AS known (id, name, version, lease, alive_until)
            VALUES (me, me_name, me_version, make_interval(secs => ttl), until)
            ON CONFLICT (id) DO UPDATE SET name = excluded.name, lease = excluded.lease, seen_at = t,
                alive_until = greatest(known.alive_until, excluded.alive_until);
            EXIT;
        END IF;
    END LOOP;
END
$$;
